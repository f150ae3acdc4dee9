"""What the compressive-sensing estimator says of a sample."""

import casadi as ca

from backsight.algebra.symmetric import vech
from backsight.algebra.update import measured, noise_of
from backsight.engine.dense import UNROLL, applied, few_entries, triangle
from backsight.estimators.cs_mhe._window import ROUNDING
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.covariance import weighted_gain
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, named_results, notation


def innovation(forced: Forced, samples: int) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance.

    ``(x, P, absent, u, y, mask) -> (e, S)``; the state still lacks what an interpolated input adds
    at its end.
    """
    system, nu = forced.system, forced.nu
    if len(system.A) <= UNROLL:
        return _innovation_of_few(forced, samples)
    s, (ny, nx) = system.s, system.C.shape
    sizes = {"x": (nx, 1), "P": (nx, nx), "absent": (1, 1), "u": (nu, 1), "y": (ny, 1)}
    x, P, absent, u, y = given = [ca.MX.sym(k, *n) for k, n in sizes.items()]
    mask = ca.MX.sym("mask", ny)
    C, D, B_next = map(few_entries, (system.C, system.D[:, :nu], system.B_next[:, :nu]))
    x_prior = x + (absent < samples) * applied(B_next, u)
    missed = leaf("missed", notation(s), lambda y, mask: {"e": measured(mask) * y})
    e = missed(y - applied(C, x_prior) - applied(D, u), mask)
    _, S, _ = weighted_gain(P, ca.MX(C), s.R, mask)
    background = (forced.F * forced.sigma**2) @ forced.F.T
    results = [e, triangle(S + ca.MX(ca.DM(background)))]
    return ca.Function("innovation", [*given, mask], results)


def _innovation_of_few(forced: Forced, samples: int) -> ca.Function:
    """The same as straight-line code."""
    system, nu = forced.system, forced.nu
    C, background = ca.sparsify(ca.DM(system.C)), (forced.F * forced.sigma**2) @ forced.F.T
    R = ca.SX(ca.DM(system.s.R))
    D, B_next = (ca.sparsify(ca.DM(k[:, :nu])) for k in (system.D, system.B_next))

    def formula(x: ca.SX, whole: ca.SX, absent: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        x_prior = x + ca.if_else(absent < samples, ca.densify(ca.mtimes(B_next, u)), 0)
        e = measured(mask) * (y - ca.mtimes(C, x_prior) - ca.mtimes(D, u))
        S = ca.mtimes([C, whole, C.T]) + ca.DM(background) + noise_of(R, mask)
        return {"e": e, "S": ca.densify(S)}

    nx = len(system.A)
    sizes = {**notation(system.s), "u": nu, "whole": (nx, nx), "absent": 1}
    return leaf("innovation", sizes, formula)


def output(forced: Forced) -> ca.Function:
    """``(x, whole, u, tail, forces)`` to state, its covariance, all inputs and forces."""
    s, nu, nf = forced.system.s, forced.nu, len(forced.names)
    nx = len(forced.system.A)

    def formula(u: ca.SX, tail: ca.SX, forces: ca.SX) -> Results:
        kept, raw = forces[:, 0] + tail, forces[:, 1] + tail
        return {
            "v": ca.vertcat(u, raw / s.su[nu:]),
            "d_hat": kept,
            "d_raw": raw,
            "d_std": ca.sqrt(forces[:, 2]),
        }

    told = leaf("forces_told", {"u": nu, "tail": nf, "forces": (nf, 3)}, formula)
    x, whole = ca.MX.sym("x", nx), ca.MX.sym("whole", nx, nx)
    given = [ca.MX.sym(told.name_in(k), *told.size_in(k)) for k in range(told.n_in())]
    results = {"x_out": x, "triangle": _triangle(nx)(whole), **named_results(told, *given)}
    inputs = ["x", "whole", *(told.name_in(k) for k in range(told.n_in()))]
    return ca.Function("output", [x, whole, *given], [*results.values()], inputs, [*results])


def _triangle(nx: int) -> ca.Function:
    """Lower triangle of a covariance (nx, nx)."""
    if nx > UNROLL:
        whole = ca.MX.sym("whole", nx, nx)
        return ca.Function("triangle", [whole], [triangle(whole)])
    P = ca.SX.sym("whole", nx, nx)
    return ca.Function("triangle", [P], [vech(P)])


def told_of_set(lam: float) -> ca.Function:
    """Info of the kernel to flags, nonzeros, steps, kkt and lam_max.

    Violations that are mere rounding are not told apart, so that every compiler gives the same.
    """

    def formula(
        status: ca.SX, kkt: ca.SX, steps: ca.SX, nonzeros: ca.SX, lam_max: ca.SX, unobserved: ca.SX
    ) -> Results:
        flags = Flags(iteration_limit=status == 1, dependent=status == 2, unobserved=unobserved)
        return {
            "flags": flags.vector(),
            "nonzeros": nonzeros,
            "steps": steps,
            "kkt": ca.fmax(kkt / lam, ROUNDING),
            "lam_max": lam_max,
        }

    info = ("status", "kkt", "steps", "nonzeros", "lam_max", "unobserved")
    return leaf("told", dict.fromkeys(info, 1), formula)
