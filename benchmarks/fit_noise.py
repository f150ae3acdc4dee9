"""A linear oscillator whose noise is looked for by maximum likelihood: what all contenders share.

The sensor's standard deviation and the steps of both states are free, in another case all of the
covariance of the process noise; nothing is known of them before. What is linear in known inputs is
known: a peer without inputs gets the recording without it.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable

import numpy as np
import scipy
import xarray as xr

import backsight as bs
from backsight.tune import Free, Tuned, fit
from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.tuning_problems import MACHINES

SAMPLES, DT, SIGMA_X0 = 3000, 0.01, 0.1
STIFFNESS, DAMPING = 100.0, 0.5
START = {"sigma_y.y": 1e-2, "sigma_w.q": 1e-3, "sigma_w.v": 1e-3}
UNKNOWN = float("inf")

PER_FIT = 1000
"""Of this many, microseconds of one are milliseconds of all."""


@functools.cache
def recording() -> xr.Dataset:
    """The recording of all fits."""
    machine = dataclasses.replace(MACHINES[0], sigma_w={"q": 2e-4, "v": 1e-2})
    return machine.record(1, samples=SAMPLES)[0]


@functools.cache
def transition() -> tuple[Array, Array]:
    """A (2, 2) and B (2, 1) of the oscillator from sample to sample."""
    joint = np.zeros((3, 3))
    joint[:2] = [[0, 1, 0], [-STIFFNESS, -DAMPING, 1]]
    whole = np.asarray(scipy.linalg.expm(joint * DT))
    return whole[:2, :2], whole[:2, 2:]


@functools.cache
def unforced() -> Array:
    """Outputs (n, 1) without what the inputs make of them."""
    A, B = transition()
    x, forced = np.zeros(2), []
    for u in recording()["u"].values:
        forced.append(x[:1])
        x = A @ x + B @ u
    return recording()["y"].values - np.array(forced)


def deviations(*, anew: bool) -> Contender:
    """Backsight, three standard deviations; `anew` with a start that no program is kept of."""
    return _ours(lambda start: (start, ["sigma_y", "sigma_w"]), deviations_of, anew=anew)


def covariance() -> Contender:
    """Backsight, the sensor and all of Q; what is put out is the likelihood."""

    def described(start: bs.Noise) -> tuple[bs.Noise, list[str | Free]]:
        Q = np.diag([START["sigma_w.q"] ** 2, START["sigma_w.v"] ** 2])
        whole = Free("Q", structure="full", spread=UNKNOWN)
        return bs.Noise(sigma_y=start.sigma_y, Q=Q), ["sigma_y", whole]

    return _ours(described, lambda found: np.array([[-found.cost]]), anew=False)


def deviations_of(found: Tuned) -> Array:
    """Standard deviations, (1, 3)."""
    return np.array([list(found.values.values())])


def _ours(
    described: Callable[[bs.Noise], tuple[bs.Noise, list[str | Free]]],
    told: Callable[[Tuned], Array],
    *,
    anew: bool,
) -> Contender:
    model, count = bs.sdof(k=STIFFNESS, b=DAMPING), itertools.count()

    def work() -> Array:
        y = START["sigma_y.y"] * (1 + 1e-9 * next(count) * anew)
        steps = {"q": START["sigma_w.q"], "v": START["sigma_w.v"]}
        noise, names = described(bs.Noise(sigma_y=y, sigma_w=steps))
        kf = bs.KalmanFilter(noise, bs.Prior(sigma_x0=SIGMA_X0))
        free = [Free(n, spread=UNKNOWN) if isinstance(n, str) else n for n in names]
        return told(fit(kf, model, recording(), free=free, check=False, restarts=0))

    return Contender(work, PER_FIT)
