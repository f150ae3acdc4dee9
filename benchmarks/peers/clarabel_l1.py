"""CVXPY with Clarabel on windows with sparse forces, the problem written down as it is."""

import warnings
from collections.abc import Callable

import numpy as np

from backsight.types import Array
from benchmarks import struck_beam
from benchmarks.cantilever import TABLE, sampled
from benchmarks.contest import Contender
from benchmarks.struck_beam import Window


def build(case: float, tolerances: dict[str, float]) -> Contender:
    """States, background forces, sparse forces and expected forces are unknowns.

    Compiled once; what changes from window to window are parameters (DPP).
    """
    solve, windows = _compiled(case, tolerances), struck_beam.windows(case)

    def work() -> Array:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of tolerances that are not reached everywhere
            return np.array([solve(window) for window in windows])

    return Contender(work, len(windows), np.array([w.forces for w in windows]))


def _compiled(case: float, tolerances: dict[str, float]) -> Callable[[Window], Array]:
    import cvxpy as cp

    (A, B, C), values = sampled(case), TABLE[case]
    (nx, nf), (samples, ny) = B.shape, struck_beam.windows(case)[0].Y.shape
    N = samples - 1
    x, start, extra = cp.Variable((samples, nx)), cp.Variable(nx), cp.Variable((N, nf))
    background, alpha = cp.Variable((N, nf)), cp.Variable((N, nf))
    x_bar, root, Y = cp.Parameter(nx), cp.Parameter((nx, nx)), cp.Parameter((samples, ny))
    mean, spread = cp.Parameter((N, nf)), cp.Parameter((N, nf))
    forces = alpha + mean + cp.multiply(spread, extra)
    moved = x[:-1] @ A.T + (forces + np.sqrt(values.eps_Q) * background) @ B.T
    cost = (
        cp.sum_squares(start)
        + cp.sum_squares(background)
        + cp.sum_squares((Y - x @ C.T) / np.sqrt(values.eps_R))
        + cp.sum_squares(extra)
        + values.lam * cp.norm1(alpha)
    )
    problem = cp.Problem(cp.Minimize(cost), [x[0] == x_bar + root @ start, x[1:] == moved])

    def solve(window: Window) -> Array:
        x_bar.value, root.value, Y.value = window.x_bar, _root(window.P), window.Y
        mean.value, spread.value = window.mean, window.spread
        problem.solve(solver=cp.CLARABEL, **tolerances)
        return np.asarray(forces.value)

    return solve


def _root(P: Array) -> Array:
    values, vectors = np.linalg.eigh(P)
    return vectors * np.sqrt(np.maximum(values, 0))
