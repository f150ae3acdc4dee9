"""Who competes on linear Kalman filters of many sizes."""

import dataclasses
import functools
from collections.abc import Sequence
from functools import partial

import numpy as np

from backsight.engine import native
from backsight.estimators import KalmanFilter, Noise, Prior
from backsight.kernels import library
from backsight.models.lti import lti
from backsight.run.simulation import simulate
from backsight.types import Array
from benchmarks.contest import Contender, Contest, Entry, Row, peer
from benchmarks.problems import Problem

SIZES = ((6, 3), (12, 6), (24, 10), (50, 20), (100, 20), (200, 60), (500, 20), (500, 200))
"""States and outputs."""

REUSED = "Backsight, gain reused once converged"
EXACT = "Backsight, gain computed at every sample"
PEERS = {
    "NumPy with BLAS": "numpy_blas",
    "statsmodels": "statsmodels",
    "dynamax (JAX)": "dynamax",
    "cuthbert (JAX)": "cuthbert",
    "kalman-py, NumPy": "kalman_py",
    "kalman-py, JAX": "kalman_py_jax",
    "fast-kalman (C++)": "fast_kalman",
}


def title(states: int, outputs: int) -> str:
    """Of the table for this size."""
    return f"Kalman filter, {states} states, {outputs} outputs, dense"


def titles() -> tuple[str, ...]:
    """Of all tables."""
    return tuple(title(*size) for size in SIZES)


def worst(rows: Sequence[Row]) -> float:
    """Our time by that of the best of the others at the worst size; NaN if one is missing."""
    times, ratios = {(r.contest, r.name): r.best for r in rows}, []
    for table in titles():
        others = [t for name in PEERS if np.isfinite(t := times.get((table, name), np.nan))]
        ratios.append(times.get((table, REUSED), np.nan) / min(others, default=np.nan))
    return float(np.max(ratios))


def samples(states: int) -> int:
    """Length of the recording: covariances of up to a few hundred states converge."""
    return int(np.clip(4e7 / states**2, 160, 4000))


def contests() -> tuple[Contest, ...]:
    """A table for each size."""
    return tuple(_contest(*size) for size in SIZES)


def _contest(states: int, outputs: int) -> Contest:
    return Contest(
        title(states, outputs),
        "us per sample",
        (
            Entry(REUSED, partial(_ours, states, outputs, "converged")),
            Entry(EXACT, partial(_ours, states, outputs, "exact")),
            *(
                Entry(name, peer("linear_filters", function, states, outputs))
                for name, function in PEERS.items()
            ),
        ),
        REMARK if (states, outputs) == SIZES[0] else "",
    )


REMARK = (
    "A discrete-time model in which every state moves every other, no inputs, all outputs "
    "measured, all of the covariances computed. Only Backsight's first line and statsmodels stop "
    "computing the covariance when it has converged. States and outputs are those of the columns."
)


@dataclasses.dataclass(frozen=True)
class Linear:
    """Matrices of a model from sample to sample, its noise, and measurements (n, ny).

    Its prior has the mean zero and the covariance P0 before the first measurement.
    """

    A: Array
    C: Array
    Q: Array
    R: Array
    P0: Array
    y: Array

    def estimates(self) -> Array:
        """Means (n, nx) after every measurement, in the plainest way."""
        x, P = np.zeros(len(self.A)), self.P0.copy()
        found = np.empty((len(self.y), len(x)))
        for k, y in enumerate(self.y):
            S = self.C @ P @ self.C.T + self.R
            K = np.linalg.solve(S, self.C @ P).T
            x, P = x + K @ (y - self.C @ x), P - K @ S @ K.T
            found[k] = x
            x, P = self.A @ x, self.A @ P @ self.A.T + self.Q
        return found


@functools.cache
def problem(states: int, outputs: int, gain: str) -> Problem:
    """A filter of slow and fast modes that are mixed by a rotation."""
    rng = np.random.default_rng(1)
    turn, _ = np.linalg.qr(rng.standard_normal((states, states)))
    angles = np.geomspace(0.02, 1.0, states // 2)
    A = np.zeros((states, states))
    for i, angle in enumerate(angles):
        block = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = 0.97 * np.array(block)
    model = lti(
        turn @ A @ turn.T,
        np.zeros((states, 0)),
        rng.standard_normal((outputs, states)) / np.sqrt(states),
        states={f"x{i}": "" for i in range(states)},
        inputs={},
        outputs={f"y{i}": "" for i in range(outputs)},
        dt=1.0,
        name="rotated modes",
    )
    noise = Noise(R=0.01 * np.eye(outputs), Q=0.01 * np.eye(states))
    kf = KalmanFilter(noise, Prior(P0=np.eye(states)), gain=gain)  # pyright: ignore[reportArgumentType]
    n = samples(states)
    return Problem(kf, model, simulate(model, np.zeros((n, 0)), dt=1.0, sigma_y=0.1, seed=0))


@functools.cache
def linear(states: int, outputs: int) -> Linear:
    """The same as matrices."""
    given = problem(states, outputs, "exact")
    s = given.setting
    A, C = (np.asarray(m) for m in _matrices(given))
    return Linear(A, C, s.Q, s.R, s.P0, given.data[1] / s.sy)


def _matrices(given: Problem) -> tuple[Array, Array]:
    from backsight.models.lti import state_space

    A, _, C, _ = state_space(given.setting.model)
    return A, C


@functools.cache
def expected(states: int, outputs: int) -> Array:
    """Estimates of another route."""
    return linear(states, outputs).estimates()


def _ours(states: int, outputs: int, gain: str) -> Contender:
    given = problem(states, outputs, gain)
    native.compiled(given.recursion)

    def work() -> Array:
        with library.one_thread():
            recursion = given.recursion
            found = native.run(recursion, given.data, carry=recursion.carry0)[1]
        return found[0] / given.setting.sx

    return Contender(work, len(given.data[0]), expected(states, outputs))
