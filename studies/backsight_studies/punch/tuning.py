"""The observers of the study, with their models, noise and start values."""

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np
import xarray as xr

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import AHG, EKF, UKF, AbstractEstimator, Noise, Prior
from backsight.estimators.observers import AdaptiveGain
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune import propose_gamma
from backsight.types import Array
from backsight_studies.punch.plant import DT, PERIOD, SIGMA_Y, Reading, friction, punch

RK4 = Integrator("rk4", 1)

LAM = {"soft": 300.0, "stiff": 1000.0}
"""Gain of the observer with fixed gain [1/s]."""

RATE, FAST = 10.0, 30.0
"""Speed of adaptation g [1/s]: as a rule, and for the comparison in the manner of the paper."""

TUNED, PLAIN, DRIFTING, PAPER = (0.01, 0.05), (1.0, 0.01), (1.0, 0.05), (3.0, 0.01)
"""Process noise of the filters: of the speed [m/s2/sqrt(Hz)], of parameters [1/sqrt(s)], relative.

The plant has none. `TUNED` is next to nothing; `PAPER` makes the filters behave as in the paper.
"""

FLOOR = 1e-3
"""Smallest value of the filters' parameters, as a share of the true ones."""


@dataclasses.dataclass(frozen=True)
class Ranges:
    """Range of an adaptive gain, and when it switches."""

    upper: float
    gain: AdaptiveGain


RANGES = {
    "soft": Ranges(1000.0, AdaptiveGain(lower=100.0, gamma=6e-7, beta=3e7, window=0.04)),
    "stiff": Ranges(2000.0, AdaptiveGain(lower=500.0, gamma=2e-7, beta=1e8, window=0.01)),
}


@dataclasses.dataclass(frozen=True)
class Variant:
    """An observer with its model.

    Parameters
    ----------
    label : str
    estimator : AbstractEstimator
    model : Model
    """

    label: str
    estimator: AbstractEstimator
    model: Model


def observer(
    label: str,
    reading: Reading,
    start: Mapping[str, float],
    motion: xr.Dataset,
    *,
    lam: float | None = None,
    rate: float = RATE,
    diagonal: bool = False,
    form: Literal["consistent", "printed"] = "consistent",
    interpolation: Literal["model", "linear", "hold"] = "model",
    adaptive: AdaptiveGain | None = None,
) -> Variant:
    """Adaptive high-gain observer, Gamma from the motion.

    Parameters
    ----------
    label, reading
    start : dict
        Start values of the parameters m, c, d.
    motion : xarray.Dataset
        From which Gamma is computed, with the true states.
    lam, rate, diagonal, form, interpolation, adaptive
        See `AHG` and `propose_gamma`.
    """
    gain = LAM[reading.name] if lam is None else lam
    joint = augment(punch(reading), ["m", "c", "d"])
    sigma = {"q": 2e-3, "v": 0.1} | {name: 0.8 * v for name, v in reading.truth.items()}
    estimator = AHG(
        Noise(sigma_y=SIGMA_Y),
        Prior(x0=dict(start), sigma_x0=sigma),
        gain=gain,
        Gamma=propose_gamma(joint, motion, gain=gain, rate=rate, period=PERIOD, diagonal=diagonal),
        form=form,
        interpolation=interpolation,
        adaptive=adaptive,
        integrator=Integrator("rk4", 2),
    )
    return Variant(label, estimator, joint)


def ekf(
    label: str, reading: Reading, start: Mapping[str, float], q: tuple[float, float]
) -> Variant:
    """Extended Kalman filter with process noise `q`, see `TUNED`."""
    noise = Noise(sigma_y=SIGMA_Y, Qc=_density(reading, q))
    prior = _prior(reading, start)
    return Variant(label, EKF(noise, prior, RK4), filter_model(reading))


def ukf(
    label: str, reading: Reading, start: Mapping[str, float], q: tuple[float, float]
) -> Variant:
    """Unscented Kalman filter, likewise.

    Its sigma points are clipped: with a prior of 1/m twice as wide as 1/m is far from zero, the
    others lose the spring in some runs, as the extended Kalman filter does.
    """
    noise = Noise(sigma_y=SIGMA_Y, Q=DT * _density(reading, q))
    prior = _prior(reading, start)
    return Variant(label, UKF(noise, prior, RK4, outside="clipped"), filter_model(reading))


def filter_model(reading: Reading) -> Model:
    """The extended state of eq. 23-24, with 1/m (the printed eq. 24 has its first rows swapped)."""
    true = reading.truth

    def parameter(unit: str, value: float) -> Signal:
        return Signal(unit, value, scale=value, lower=FLOOR * value)

    return Model(
        f=lambda x, u, _p: [
            x.v,
            x.inverse * (u.F - x.c * x.q - x.d * x.v - friction(x.v)),
            0,
            0,
            0,
        ],
        h=lambda x, _u, _p: [x.q],
        states={
            "q": Signal("m", scale=1e-3),
            "v": Signal("m/s", scale=0.1),
            "c": parameter("N/m", true["c"]),
            "d": parameter("N s/m", true["d"]),
            "inverse": parameter("1/kg", 1 / true["m"]),
        },
        inputs={"F": "N"},
        outputs={"y": Signal("m", scale=1e-3)},
        name=f"punch, {reading.name} spring, with 1/m",
    )


def _sizes(reading: Reading) -> Array:
    return np.array([1e-3, 0.1, reading.stiffness, reading.truth["d"], 1 / reading.truth["m"]])


def _density(reading: Reading, q: tuple[float, float]) -> Array:
    """Spectral density of the process noise, (5, 5)."""
    speed, relative = q
    density = np.array([0.0, speed / 0.1, relative, relative, relative]) ** 2
    return np.diag(density * _sizes(reading) ** 2)


def _prior(reading: Reading, start: Mapping[str, float]) -> Prior:
    spread = np.array([2.0, 0.1, 0.8, 0.8, 0.8]) * _sizes(reading)
    x0 = {"c": start["c"], "d": start["d"], "inverse": 1 / start["m"]}
    return Prior(sigma_x0=spread, x0=x0)


def scaled_start(reading: Reading, factor: float) -> dict[str, float]:
    """All parameters too large by the same factor, as in the paper."""
    return {name: factor * value for name, value in reading.truth.items()}
