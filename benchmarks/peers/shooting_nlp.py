"""CasADi's solvers on windows with process noise: IPOPT, fatrop, and `sqpmethod` with HPIPM.

States and noise are unknowns, in the order in which fatrop and HPIPM find the structure.
"""

import functools
from typing import Any

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import process_noise
from benchmarks.contest import Contender
from benchmarks.process_noise import Window

SCALE = 1e-3
"""Of the cost: with it, fatrop and HPIPM end by their own tests."""

QUIET: dict[str, dict[str, Any]] = {
    "ipopt": {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9},
    "fatrop": {"structure_detection": "auto", "fatrop.print_level": 0},
    "hpipm": {
        "qpsol": "hpipm",
        "qpsol_options": {"error_on_fail": False},
        "convexify_strategy": "eigen-reflect",
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
    },
}

TIGHT = QUIET["ipopt"] | {
    "ipopt.tol": 1e-14,
    "ipopt.compl_inf_tol": 1e-15,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.acceptable_iter": 0,
}


def build(bounds: str, solver: str) -> Contender:
    """The windows one after the other, each begun with the solution of the window before."""
    solve = _solver(bounds, solver, QUIET[solver])
    windows = process_noise.windows(bounds)
    return Contender(lambda: _solutions(bounds, solve), len(windows), minimisers(bounds))


@functools.cache
def minimisers(bounds: str) -> Array:
    """States at the end of the windows by IPOPT with the tightest tolerance, (windows, nx)."""
    return _solutions(bounds, _solver(bounds, "ipopt", TIGHT))


def _solutions(bounds: str, solve: ca.Function) -> Array:
    lower = process_noise.problem(bounds).setting.lower
    return np.array([_solution(solve, lower, window) for window in process_noise.windows(bounds)])


def _solution(solve: ca.Function, lower: Array, window: Window) -> Array:
    N, nx = len(window.Y) - 1, len(window.x_bar)
    unbounded, still = np.full((N, nx), -np.inf), np.zeros((N, nx))
    found = solve(
        x0=_in_order(window.guess, still),
        p=np.concatenate([window.x_bar, window.U, window.Y]),
        lbx=_in_order(np.tile(lower, (N + 1, 1)), unbounded),
        lbg=0,
        ubg=0,
    )
    return np.asarray(found["x"]).ravel()[-nx:]


def _in_order(states: Array, noise: Array) -> Array:
    """First state, first noise, second state, ..., last state."""
    pairs = np.hstack([states[:-1], noise]).ravel()
    return np.concatenate([pairs, states[-1]])


def _solver(bounds: str, solver: str, options: dict[str, Any]) -> ca.Function:
    """Unknown are the states and the noise in standard deviations."""
    problem = process_noise.problem(bounds)
    s, N, nx = problem.setting, problem.estimator.N, problem.setting.model.nx
    ahead, output = transition(bounds)
    x_bar, U, Y = ca.SX.sym("x_bar", nx), ca.SX.sym("U", N + 1), ca.SX.sym("Y", N + 1)
    X, W = ca.SX.sym("x", nx, N + 1), ca.SX.sym("w", nx, N)
    sigma_x, sigma_w = np.sqrt(np.diag(s.P0)), np.sqrt(np.diag(s.sampled().Q))
    e = ca.vertcat(*(Y[k] - output(X[:, k]) for k in range(N + 1)))
    prior = (X[:, 0] - x_bar) / sigma_x
    gaps = [X[:, k + 1] - ahead(X[:, k], U[k]) - sigma_w * W[:, k] for k in range(N)]
    nlp = {
        "x": ca.vertcat(*(ca.vertcat(X[:, k], W[:, k]) for k in range(N)), X[:, N]),
        "p": ca.vertcat(x_bar, U, Y),
        "f": SCALE * (ca.sumsqr(prior) + ca.sumsqr(W) + ca.sumsqr(e) / s.R[0, 0]) / 2,
        "g": ca.vertcat(*gaps),
    }
    options = options | {"print_time": False, "error_on_fail": False}
    if solver == "fatrop":
        options["equality"] = [True] * nlp["g"].numel()
    return ca.nlpsol("window", "sqpmethod" if solver == "hpipm" else solver, nlp, options)


def transition(bounds: str) -> tuple[ca.Function, ca.Function]:
    """``(x, u) -> x`` over one sample, and ``x -> y``, both scaled."""
    problem = process_noise.problem(bounds)
    s, integrator = problem.setting, problem.estimator.integrator
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u")
    ahead = x
    for _ in range(integrator.substeps):
        ahead = integrator.substep(s.model.rhs, ahead, ua=u, ub=u, h=s.dt / integrator.substeps)
    output = ca.Function("output", [x], [s.model.output(x, ca.SX(0))])
    return ca.Function("ahead", [x, u], [ahead]), output
