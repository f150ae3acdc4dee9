"""Innovation of a sample before it enters the window."""

import casadi as ca

from backsight.algebra.update import measured, noise_of
from backsight.engine.dense import UNROLL, applied, few_entries, triangle
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.covariance import innovation_covariance
from backsight.estimators.parts.leaf import Results, leaf, notation


def innovation_of_window(forced: Forced, samples: int) -> ca.Function:
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
    S = innovation_covariance(P, ca.MX(C), s.R, mask)
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
