"""The punch as the tests of its observers use it."""

import functools

import numpy as np
import xarray as xr

from backsight.estimators import AHG, Prior
from backsight.estimators import Noise as SensorNoise
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.tune import propose_gamma
from backsight_studies.punch.plant import PERIOD, STIFF, Reading, punch, simulate_punch

SIGMA = {"q": 2e-3, "v": 0.1}


@functools.cache
def motion(reading: Reading = STIFF, seconds: float = 1.3) -> xr.Dataset:
    """The punch along its strokes, without noise."""
    return simulate_punch(reading, seconds=seconds)


def joint(reading: Reading = STIFF) -> Model:
    return augment(punch(reading), ["m", "c", "d"])


@functools.cache
def gamma(reading: Reading = STIFF, lam: float = 1000.0, rate: float = 10.0) -> np.ndarray:
    return propose_gamma(joint(reading), motion(reading), gain=lam, rate=rate, period=PERIOD)


def observer(
    factor: float = 1.2, *, reading: Reading = STIFF, lam: float = 1000.0, rate: float = 10.0,
    **settings,
) -> AHG:  # fmt: skip
    """Adaptive observer that starts with all parameters too large by a factor."""
    truth = reading.truth
    prior = Prior(
        x0={name: factor * value for name, value in truth.items()},
        sigma_x0=SIGMA | {name: 0.8 * value for name, value in truth.items()},
    )
    given = {"gain": lam, "Gamma": gamma(reading, lam, rate)} | settings
    return AHG(SensorNoise(sigma_y=1e-6), prior, **given)
