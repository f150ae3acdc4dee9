"""Everything that the study computes."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np

from backsight.data import increments
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman import KalmanFilter
from backsight.estimators.linear_windows import LinearMHE, RecursiveMHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.models.views.incremental import incremental
from backsight.run.estimation import estimate
from backsight.types import Array
from backsight_studies.lecture.plants import (
    EXAMPLE,
    FORCE,
    Motion,
    every,
    example_motion,
    masses_motion,
    two_masses,
)
from backsight_studies.study import Progress

BATCH = ((2, 8), (4, 16))
"""Pairs of every m-th sample and horizon N of the lecture's batch figures."""

RECURSIVE = ((2, 6), (4, 12))
"""The same of its recursive figures."""

ALPHAS = tuple(k / 10 for k in range(11))
STEP, STEP_HORIZON = 40, 5
"""Sample at which the unknown input of the incremental example jumps, and the horizon there."""

UNIT = Noise(1.0)
WIDE = Prior(1.0)


@dataclasses.dataclass(frozen=True)
class Multirate:
    """States estimated from every m-th sample, and the truth."""

    plant: str
    m: int
    N: int
    truth: Array
    estimates: dict[str, Array]
    batch_error: float
    exact: float


@dataclasses.dataclass(frozen=True)
class Alpha:
    """Root mean square errors by alpha, and the largest eigenvalue of the error."""

    rmse: Array
    kalman: float
    modulus: Array


@dataclasses.dataclass(frozen=True)
class Limited:
    """The unknown force: truth, estimate without and with its bounds, and both rms errors."""

    truth: Array
    free: Array
    bounded: Array
    rmse: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Experiment:
    """All results of the study."""

    multirate: dict[tuple[str, int, int], Multirate]
    rounding: Array
    again: Array
    alpha: Alpha
    incremental: Array
    plain: Array
    limited: Limited


def carry_out(seeds: Sequence[int], progress: Progress) -> Experiment:
    """Compute everything, with the random numbers of the first seed."""
    seed = seeds[0]
    progress("simulating and estimating", 0.0)
    found = [
        multirate(name, m, N, seed=seed)
        for name in ("two states", "two masses")
        for m, N in (*BATCH, *RECURSIVE)
    ]
    rounding, again = rounding_errors(seed)
    with_increments, plain = input_step(seed)
    return Experiment(
        multirate={(r.plant, r.m, r.N): r for r in found},
        rounding=rounding,
        again=again,
        alpha=sweep(seed),
        incremental=with_increments,
        plain=plain,
        limited=limits(seed),
    )


def multirate(name: str, m: int, N: int, *, seed: int) -> Multirate:
    """Batch, recursion and Kalman filter on every m-th sample of a noisy motion."""
    rng = np.random.default_rng(seed)
    if name == "two states":
        model, motion, sigma = EXAMPLE, example_motion(140, rng=rng), 0.05
    else:
        model, sigma = two_masses(unknown_force=False), 2e-3
        motion = masses_motion(140, rng=rng, force=0.0)
    noise = Noise(sigma)
    y = every(m, motion.y + sigma * rng.standard_normal(motion.y.shape))
    batch = LinearMHE(noise, WIDE, N=N)
    recursion = RecursiveMHE(noise, WIDE, N=N, alpha=1.0, every=m)
    estimates = {
        "batch": states(batch, model, motion, y),
        "recursive": states(recursion, model, motion, y),
        "Kalman filter": states(KalmanFilter(noise, WIDE), model, motion, y),
    }
    slow = np.arange(N, N + 5 * m, m)
    size = np.abs(estimates["batch"][slow]).max()
    difference = np.abs(estimates["recursive"] - estimates["batch"])[slow].max() / size
    clean = states(batch, model, motion, every(m, motion.y))[N:]
    return Multirate(
        plant=name,
        m=m,
        N=N,
        truth=motion.x,
        estimates=estimates,
        batch_error=float(difference),
        exact=float(np.abs(clean - motion.x[N:]).max() / np.abs(motion.x).max()),
    )


def rounding_errors(seed: int) -> tuple[Array, Array]:
    """Difference of recursion (alpha = 1) and batch over time, never and sometimes restarted."""
    rng = np.random.default_rng(seed)
    motion = example_motion(261, rng=rng)
    y = motion.y + 0.05 * rng.standard_normal(motion.y.shape)
    batch = states(LinearMHE(UNIT, WIDE, N=4), EXAMPLE, motion, y)
    never, sometimes = (
        np.abs(
            states(RecursiveMHE(UNIT, WIDE, N=4, alpha=1.0, reinitialise=r), EXAMPLE, motion, y)
            - batch
        ).max(axis=1)
        for r in (0, 20)
    )
    return never, sometimes


def sweep(seed: int) -> Alpha:
    """Errors of the recursion over alpha on a motion with noise in plant and sensor."""
    rng = np.random.default_rng(seed)
    n, N, sigma, walk = 4000, 6, 0.05, 0.02
    clean = example_motion(n, rng=rng)
    disturbance = walk * rng.standard_normal((n, 2))
    x, truth = np.zeros(2), []
    for u, w in zip(clean.u, disturbance, strict=True):
        truth.append(x)
        x = np.array(EXAMPLE.f(x, u, [])).ravel() + w
    motion = Motion(np.array(truth), clean.u, np.array(truth)[:, :1])
    y = motion.y + sigma * rng.standard_normal((n, 1))
    observers = [
        RecursiveMHE(Noise(sigma), WIDE, N=N, alpha=alpha, reinitialise=20) for alpha in ALPHAS
    ]
    errors = [rms(states(o, EXAMPLE, motion, y) - motion.x) for o in observers]
    kalman = states(KalmanFilter(Noise(sigma, walk), WIDE), EXAMPLE, motion, y)
    return Alpha(
        rmse=np.array(errors),
        kalman=rms(kalman - motion.x),
        modulus=np.array([np.abs(o.eigenvalues(EXAMPLE, 1.0)).max() for o in observers]),
    )


def input_step(seed: int) -> tuple[Array, Array]:
    """Largest errors over time with the incremental and with the plain model."""
    n = 2 * STEP
    load = np.where(np.arange(n) >= STEP, 2.0, 0.0)
    motion = example_motion(n, rng=np.random.default_rng(seed), load=load)
    data = motion.recording(EXAMPLE, motion.y)
    mhe = LinearMHE(UNIT, WIDE, N=STEP_HORIZON)
    found = estimate(mhe, incremental(EXAMPLE), increments(data))["x_hat"].values
    truth = np.hstack([np.diff(motion.x, axis=0, prepend=motion.x[:1]), motion.y])
    plain = states(mhe, EXAMPLE, motion, motion.y)
    return np.abs(found - truth).max(axis=1), np.abs(plain - motion.x).max(axis=1)


def limits(seed: int) -> Limited:
    """The unknown force on the second mass, which never exceeds its bounds."""
    rng = np.random.default_rng(seed)
    motion = masses_motion(400, rng=rng, force=FORCE)
    y = motion.y + 2e-3 * rng.standard_normal(motion.y.shape)
    model = two_masses(unknown_force=True)
    noise = Noise(2e-3, {"d": 0.3 * FORCE})
    mhe = LinearMHE(noise, WIDE, N=20)
    free = states(mhe, without_bounds(model), motion, y)[:, 4]
    bounded = states(mhe, model, motion, y)[:, 4]
    truth = motion.x[:, 4]
    start = 20
    errors = (rms((free - truth)[start:]), rms((bounded - truth)[start:]))
    return Limited(truth, free, bounded, errors)


def without_bounds(model: Model) -> Model:
    """The same model with states that may take any value."""
    free = [dataclasses.replace(s, lower=-np.inf, upper=np.inf) for s in model.states]
    return dataclasses.replace(model, states=tuple(free))


def states(estimator: AbstractEstimator, model: Model, motion: Motion, y: Array) -> Array:
    """Estimated states; that the recursion is unstable is what the study shows."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the recursion with alpha")
        return estimate(estimator, model, motion.recording(model, y))["x_hat"].values


def rms(error: Array) -> float:
    """Root mean square over everything."""
    return float(np.sqrt(np.mean(error**2)))
