"""CasADi's general solvers on the windows: `sqpmethod` with `qrqp`, and IPOPT."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import problems
from benchmarks.contest import Contender
from benchmarks.windows import Window, minimisers, response, windows

QUIET: dict[str, dict[str, Any]] = {
    "sqpmethod": {
        "qpsol": "qrqp",
        "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "tol_pr": 1e-9,
        "tol_du": 1e-6,
    },
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9},
}


def build(solver: str) -> Contender:
    """Single shooting; unknown is z with x = x_bar + L z, the prior's own coordinates."""
    problem = problems.observer()
    s, N, nx = problem.setting, problem.estimator.N, problem.setting.model.nx
    z, p = ca.SX.sym("z", nx), ca.SX.sym("p", nx + nx * nx + 2 * (N + 1))
    x_bar, L, U, Y = ca.vertsplit(p, [0, nx, nx + nx * nx, nx + nx * nx + N + 1, p.numel()])
    x = x_bar + ca.reshape(L, nx, nx) @ z
    e = Y - response(s, problem.estimator.integrator, x, U)
    cost = ca.sumsqr(z) / 2 + ca.sumsqr(e) / (2 * s.R[0, 0])
    bounded = np.flatnonzero(np.isfinite(s.lower))
    nlp = {"x": z, "p": p, "f": cost, "g": x[[int(i) for i in bounded]]}
    options = QUIET[solver] | {"print_time": False, "error_on_fail": False}
    solve = ca.nlpsol("window", solver, nlp, options)

    def one(window: Window) -> Array:
        p = np.concatenate([window.x_bar, window.L.T.ravel(), window.U, window.Y])
        solution = solve(x0=0, p=p, lbg=s.lower[bounded], ubg=np.inf)
        return window.x_bar + window.L @ np.asarray(solution["x"]).ravel()

    return each(one, count=len(windows()))


def each(solve: Callable[[Window], Array], *, count: int) -> Contender:
    """A contender that solves the first windows, one after the other."""
    chosen = windows()[:count]
    return Contender(lambda: np.array([solve(w) for w in chosen]), count, minimisers())
