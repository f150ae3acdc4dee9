"""OSQP on windows with sparse forces, each begun with the solution of the last one.

It gets the dual of the condensed problem: the point nearest to the whitened measurements whose
correlation with every force is at most half of lam; the forces are its multipliers. That is the
smallest form: 33 unknowns and 80 two-sided limits. Condensing is not counted.
"""

import contextlib
import os
from collections.abc import Iterator

import numpy as np
import scipy

from backsight.types import Array
from benchmarks import struck_beam
from benchmarks.cantilever import TABLE, sampled
from benchmarks.contest import Contender
from benchmarks.struck_beam import Window

SETTINGS = {
    "eps_abs": 1e-6,
    "eps_rel": 0.0,
    "max_iter": 20_000,
    "polishing": True,
    "verbose": False,
}
"""With them the polished forces are exact."""


def build(case: float) -> Contender:
    import osqp

    windows = struck_beam.windows(case)
    condensed = [_condensed(case, window) for window in windows]
    effects, measured = condensed[0]
    # Every entry is kept, so that the next windows fit the same pattern.
    pattern = scipy.sparse.csc_matrix(np.ones(effects.T.shape))
    pattern.data = effects.ravel()
    limit = np.full(effects.shape[1], TABLE[case].lam / 2)
    solver = osqp.OSQP()
    solver.setup(
        P=scipy.sparse.eye(len(measured), format="csc"),
        q=-measured,
        A=pattern,
        l=-limit,
        u=limit,
        **SETTINGS,
    )

    def solve(effects: Array, measured: Array, window: Window) -> Array:
        solver.update(q=-measured, Ax=effects.ravel())
        alpha = solver.solve(raise_error=True).y
        unexplained = effects.T @ (measured - effects @ alpha)
        return (window.mean.ravel() + alpha + window.spread.ravel() ** 2 * unexplained).reshape(
            window.mean.shape
        )

    def work() -> Array:
        with _silent():
            pairs = zip(condensed, windows, strict=True)
            return np.array([solve(*matrices, window) for matrices, window in pairs])

    return Contender(work, len(windows), np.array([w.forces for w in windows]))


def _condensed(case: float, window: Window) -> tuple[Array, Array]:
    """Effects of the forces (outputs, forces) and measurements, with unit noise."""
    (A, B, C), values = sampled(case), TABLE[case]
    N, nf = window.mean.shape
    powers = [np.eye(len(A))]
    for _ in range(N):
        powers.append(A @ powers[-1])
    states = np.zeros((N + 1, len(A), N * nf))
    for k in range(N):
        for j in range(k + 1):
            states[k + 1, :, j * nf : (j + 1) * nf] = powers[k - j] @ B
    start, effects = np.vstack([C @ p for p in powers]), np.vstack(list(C @ states))
    S = values.eps_Q * effects @ effects.T + values.eps_R * np.eye(len(effects))
    S += start @ window.P @ start.T + (effects * window.spread.ravel() ** 2) @ effects.T
    e = window.Y.ravel() - start @ window.x_bar - effects @ window.mean.ravel()
    factor = np.linalg.cholesky(S)
    white = scipy.linalg.solve_triangular(factor, np.column_stack([effects, e]), lower=True)
    return white[:, :-1], white[:, -1]


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """OSQP says it when there is nothing to polish, whatever its settings."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)
