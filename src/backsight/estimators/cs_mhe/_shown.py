"""What is shown of a window: the estimate of a sample, its forces, and how the search went."""

import casadi as ca

from backsight.algebra.symmetric import vech
from backsight.engine.dense import UNROLL, triangle
from backsight.engine.recursion import Channel
from backsight.estimators.cs_mhe._window import ROUNDING, SMALL
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, named_results

NUMBERS = ("nonzeros", "steps", "kkt", "gap", "lam_max")
"""Outputs about the active set."""

NEAR = 1e-9
"""Duality gap, as a share of the cost, up to which a window counts as solved."""


def channels(names: tuple[str, ...], limits: tuple[str, ...]) -> tuple[Channel, ...]:
    """Beside those that every estimator has."""
    forces = (Channel(n, ("force",), labels=names) for n in ("d_hat", "d_raw", "d_std"))
    told = [Channel("infeasible", ("limit",), labels=limits)] if limits else []
    return (*forces, *map(Channel, NUMBERS), *told)


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


def how_it_went(lam: float) -> ca.Function:
    """Info of the kernel to flags, nonzeros, steps, kkt, gap and lam_max.

    What is mere rounding is not told apart, so that every compiler gives the same.
    """

    def formula(
        status: ca.SX, kkt: ca.SX, steps: ca.SX, nonzeros: ca.SX, lam_max: ca.SX, unobserved: ca.SX,
        gap: ca.SX, clipped: ca.SX, infeasible: ca.SX,
    ) -> Results:  # fmt: skip
        flags = Flags(
            iteration_limit=status == 1,
            dependent=status == 2,
            unobserved=unobserved,
            clipped=clipped,
            infeasible=infeasible,
            not_optimal=gap > NEAR,
        )
        return {
            "flags": flags.vector(),
            "nonzeros": nonzeros,
            "steps": steps,
            "kkt": ca.fmax(kkt / lam, ROUNDING),
            "gap": ca.fmax(gap, SMALL),
            "lam_max": lam_max,
        }

    info = ("status", "kkt", "steps", "nonzeros", "lam_max", "unobserved")
    rest = ("gap", "clipped", "infeasible")
    return leaf("told", dict.fromkeys((*info, *rest), 1), formula)
