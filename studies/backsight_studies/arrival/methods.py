"""What is compared: Kalman filters, and windows with every arrival cost."""

import dataclasses

from backsight.estimators.arrival import (
    ConstantArrival,
    EKFArrival,
    NoArrival,
    SmoothedArrival,
    UKFArrival,
)
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman import EKF, UKF, KalmanFilter
from backsight.estimators.mhe import MHE
from backsight.models.model import Model
from backsight_studies.arrival.plants import HORIZONS, INTEGRATOR, REACTOR, SPRING, Plant, unbounded

NONE, CONSTANT, SMOOTHED, NAIVE = "none", "constant", "smoothed", "smoothed, naive"

ARRIVALS: dict[str, NoArrival | ConstantArrival | EKFArrival | UKFArrival | SmoothedArrival] = {
    NONE: NoArrival(),
    CONSTANT: ConstantArrival(),
    "EKF": EKFArrival(),
    "UKF": UKFArrival(),
    SMOOTHED: SmoothedArrival(),
    NAIVE: SmoothedArrival(naive=True),
}
"""Every arrival cost by its name in tables and figures."""

SOUND = ("EKF", "UKF", SMOOTHED)
"""Those that count no measurement twice."""

FREE = "smoothed, no bounds"

KALMAN, CLIPPED, UNSCENTED = "EKF alone", "EKF alone, clipped", "UKF alone, clipped"
"""Filters without a window; clipped means that estimates, or sigma points, are set to bounds."""

MOVED = "UKF alone, moved"
"""Its pairs of sigma points are moved inside the bounds, the default."""

LINEAR = "Kalman filter"


@dataclasses.dataclass(frozen=True)
class Variant:
    """An estimator with its model.

    Parameters
    ----------
    label : str
    N : int
        Horizon, 0 for a filter.
    estimator : AbstractEstimator
    model : Model
    """

    label: str
    N: int
    estimator: AbstractEstimator
    model: Model


def variants(plant: Plant) -> list[Variant]:
    """Everything that runs on a plant; the filter that others are held against comes first."""
    found = filters(plant)
    for N in HORIZONS:
        found += [window(plant, label, N) for label in ARRIVALS]
        if plant.name == REACTOR:
            free = unbounded(plant.model)
            found.append(dataclasses.replace(window(plant, SMOOTHED, N), label=FREE, model=free))
    return found


def filters(plant: Plant) -> list[Variant]:
    """Filters without a window."""
    noise, prior = plant.noise, plant.prior
    if plant.name == SPRING:
        return [Variant(LINEAR, 0, KalmanFilter(noise, prior), plant.model)]
    extended = EKF(noise, prior, INTEGRATOR, covariance="discrete")
    unscented = UKF(noise, prior, INTEGRATOR, outside="clipped")
    moved = dataclasses.replace(unscented, outside="moved")
    return [
        Variant(KALMAN, 0, extended, unbounded(plant.model)),
        Variant(CLIPPED, 0, extended, plant.model),
        Variant(UNSCENTED, 0, unscented, plant.model),
        Variant(MOVED, 0, moved, plant.model),
    ]


def window(plant: Plant, label: str, N: int) -> Variant:
    """Moving horizon estimator with one of `ARRIVALS`."""
    estimator = MHE(plant.noise, plant.prior, N=N, arrival=ARRIVALS[label], integrator=INTEGRATOR)
    return Variant(label, N, estimator, plant.model)
