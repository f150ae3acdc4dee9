"""Impose the limits of a window on its estimate."""

import casadi as ca

from backsight.engine.dense import add_product, transpose
from backsight.estimators.base import Setting
from backsight.estimators.gaussian import clip
from backsight.schema import Status
from backsight.solvers.inequalities import limited

RAISED = (Status.CLIPPED, Status.INFEASIBLE, Status.ITERATION_LIMIT)
"""Meaning of the flags of `impose`."""


def impose(s: Setting, n: int, N: int) -> ca.Function:
    """``(x, c, M, Psi, lower, upper, before) -> (x, active, conflict, flags)``.

    c, M and Psi are mean and covariance of the n (N + 1) limited quantities and their covariance
    with x, ``before`` the rows that were active in the window one sample ago. ``conflict`` (n,) is
    1 for limits that contradict each other; x is then not changed. The flags are `RAISED`.
    """
    nx, total = s.model.nx, n * (N + 1)
    x, M, Psi = ca.MX.sym("x", nx), ca.MX.sym("M", total, total), ca.MX.sym("Psi", total, nx)
    c, lower, upper, before = (ca.MX.sym(v, total) for v in ("c", "low", "high", "before"))
    tried = ca.vertcat(before[n:], ca.MX.zeros(n))
    lam, side, conflict, stuck, go = limited(total)(M, c, lower, upper, tried)
    moved = add_product(x.T, lam.T, transpose(Psi))
    results = _finish(s, n, N)(x, moved.T, side, conflict, stuck, go)
    return ca.Function("impose", [x, c, M, Psi, lower, upper, before], list(results))


def _finish(s: Setting, n: int, N: int) -> ca.Function:
    x, moved = ca.SX.sym("x", s.model.nx), ca.SX.sym("moved", s.model.nx)
    side, conflict = (ca.SX.sym(v, n * (N + 1)) for v in ("side", "conflict"))
    stuck, go = ca.SX.sym("stuck"), ca.SX.sym("go")
    inside = ca.if_else(stuck, x, clip(s, moved))
    active = ca.if_else(stuck, 0, side**2)
    of_window = ca.reshape(conflict, n, N + 1)
    named = ca.vertcat(*(ca.mmax(of_window[i, :]) for i in range(n)))
    flags = ca.vertcat(ca.mmax(active[n * N :]), stuck, go)
    return ca.Function(
        "finish", [x, moved, side, conflict, stuck, go], [inside, active, named, flags]
    )
