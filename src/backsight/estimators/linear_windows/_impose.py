"""Impose the limits of a window on its estimate."""

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.dense import add_product, transpose
from backsight.estimators.base import Setting
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.substeps import within_bounds
from backsight.solvers.limits import limited

ROUNDING = 1e-10
"""Share of a variance below which the active limits leave nothing of it."""


def impose(s: Setting, n: int, N: int) -> ca.Function:
    """``(x, P, c, M, Psi, lower, upper, before) -> (x, P, active, conflict, flags)``.

    c, M and Psi are mean and covariance of the n (N + 1) limited quantities and their covariance
    with x, ``before`` the sides of the rows in the window one sample ago. P (lower triangle)
    becomes the covariance with the active limits as exact measurements. ``conflict`` (n,) is 1 for
    limits that contradict each other; x and P are then not changed.
    """
    nx, total = s.model.nx, n * (N + 1)
    x, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    M, Psi = ca.MX.sym("M", total, total), ca.MX.sym("Psi", total, nx)
    c, lower, upper, before = (ca.MX.sym(v, total) for v in ("c", "low", "high", "before"))
    tried = ca.vertcat(before[n:], ca.MX.zeros(n))
    lam, side, inverse, conflict, stuck, go = limited(total)(M, c, lower, upper, tried)
    by_limits = transpose(Psi)
    moved = add_product(x.T, lam.T, by_limits).T
    gain = add_product(ca.MX.zeros(total, nx), inverse, by_limits)
    seen = add_product(ca.MX.zeros(nx, nx), by_limits, transpose(gain))
    results = _finish(s, n, N)(x, moved, vP, seen, side, conflict, stuck, go)
    return ca.Function("impose", [x, vP, c, M, Psi, lower, upper, before], list(results))


def _finish(s: Setting, n: int, N: int) -> ca.Function:
    nx = s.model.nx
    x, moved = ca.SX.sym("x", nx), ca.SX.sym("moved", nx)
    vP, seen = ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("seen", nx, nx)
    side, conflict = (ca.SX.sym(v, n * (N + 1)) for v in ("side", "conflict"))
    stuck, go = ca.SX.sym("stuck"), ca.SX.sym("go")
    inside = ca.if_else(stuck, x, within_bounds(s, moved))
    left = unvech(vP) - seen
    # What is left of the variance in a fixed direction is rounding, and may be below zero.
    known = ca.diag(left) <= ROUNDING * ca.diag(unvech(vP))
    free = ca.diag(ca.if_else(known, 0, 1))
    P = ca.if_else(stuck, vP, vech(free @ left @ free))
    active = ca.if_else(stuck, 0, side)
    of_window = ca.reshape(conflict, n, N + 1)
    named = ca.vertcat(*(ca.mmax(of_window[i, :]) for i in range(n)))
    clipped = ca.mmax(active[n * N :] ** 2)
    flags = Flags(clipped=clipped, infeasible=stuck, iteration_limit=go).vector()
    return ca.Function(
        "finish",
        [x, moved, vP, seen, side, conflict, stuck, go],
        [inside, P, active, named, flags],
    )
