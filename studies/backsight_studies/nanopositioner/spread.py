"""Mean and range of a measure over the recordings of a scenario."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backsight_studies.nanopositioner.experiment import Experiment


@dataclasses.dataclass(frozen=True)
class Spread:
    """Mean, smallest and largest value; NaN if one of them is."""

    mean: float
    low: float
    high: float


def spread(experiment: Experiment, scenario: str, label: str, field: str) -> Spread:
    """Of a field of `Measures`, for the variant with this label."""
    return _spread([getattr(m[label], field) for m in experiment.trials(scenario)])


def ratio(experiment: Experiment, scenario: str, label: str, field: str) -> Spread:
    """Of a field per that of the EKF on the same recording."""
    trials = experiment.trials(scenario)
    return _spread([getattr(m[label], field) / getattr(m["EKF"], field) for m in trials])


def _spread(values: Sequence[float]) -> Spread:
    return Spread(float(np.mean(values)), float(np.min(values)), float(np.max(values)))
