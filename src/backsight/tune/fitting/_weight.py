"""Weight and threshold of sparse forces as values of a fit.

The weight is what other sensors say, or what is left over; the threshold what noise does not reach.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.tune.fitting.tuned import Tuned, correlation_of
from backsight.tune.fitting.values import number_at, with_setting
from backsight.tune.force_threshold import threshold_from_noise
from backsight.tune.lambda_choice import LambdaChoice, lambda_from_sensors, lambda_from_whiteness

ALARM = 0.05
"""Share of recordings of noise in which a force may be shown."""

AS_GOOD = 4.0
"""By how much the price of a weight may be above the lowest one to be as good."""


@dataclasses.dataclass(frozen=True)
class _Found:
    """The weight of one recording.

    Parameters
    ----------
    choice : LambdaChoice
    size : float
        Standard deviation of its logarithm.
    cost, before : float
        Half the squares at the weight, and at the one before.
    """

    choice: LambdaChoice
    size: float
    cost: float
    before: float


def tuned_weight(
    estimator: AbstractForceEstimator, model: Model, recordings: Sequence[xr.Dataset]
) -> Tuned:
    """Weight with which sensors predict each other as well as with any; the rest as `Tuned` has it.

    Of one sensor the weight that leaves nothing but noise at the least expense. Several recordings
    have the mean of the logarithms of theirs. The standard deviation is that of a weight that could
    lie anywhere among those that do as well, or the spread between recordings if it is larger.
    """
    found = [_of(estimator, model, recording) for recording in recordings]
    logs = np.log([f.choice.lam for f in found])
    n = len(found)
    size = float(np.mean([f.size for f in found])) / np.sqrt(n)
    if n > 1:
        size = max(size, float(logs.std(ddof=1)) / np.sqrt(n))
    lam = float(np.exp(logs.mean()))
    doubts = [
        f"the weight of recording {i + 1} is the best of those tried, but no good one: the model "
        "is wrong, or the noise is not as stated"
        for i, f in enumerate(found)
        if not f.choice.reached
    ]
    return _tuned(
        ("lam", lam, lam * size, ""),
        estimator,
        model,
        recordings,
        costs=(sum(f.before for f in found), sum(f.cost for f in found)),
        doubts=doubts,
    )


def tuned_threshold(
    estimator: AbstractForceEstimator, model: Model, recordings: Sequence[xr.Dataset]
) -> Tuned:
    """Threshold above which noise alone shows a force in one of twenty recordings.

    Of several recordings the largest. The criterion is the share of recordings of noise in which a
    force is shown; the standard deviation is what follows from the number of those that are drawn.
    """
    found = [threshold_from_noise(estimator, model, r, false_alarm=ALARM) for r in recordings]
    choice = max(found, key=lambda f: f.threshold)
    doubt = np.sqrt(ALARM * (1 - ALARM) / len(choice.largest))
    ends = np.quantile(choice.largest, np.clip([1 - ALARM - doubt, 1 - ALARM + doubt], 0, 1))
    doubts = []
    if choice.threshold == 0:
        doubts = [
            "threshold is not needed: the weight lam alone lets no noise through; a smaller lam "
            "finds smaller forces"
        ]
    unit = next(s.unit for s in model.parameters if s.name == estimator.forces[0])
    return _tuned(
        ("threshold", choice.threshold, float(np.ptp(ends)) / 2, unit),
        estimator,
        model,
        recordings,
        costs=(choice.false_alarm(estimator.threshold), choice.false_alarm(choice.threshold)),
        doubts=doubts,
    )


def _tuned(
    what: tuple[str, float, float, str],
    estimator: AbstractForceEstimator,
    model: Model,
    recordings: Sequence[xr.Dataset],
    *,
    costs: tuple[float, float],
    doubts: Sequence[str],
) -> Tuned:
    """What was found of one setting: its name, value, standard deviation and unit."""
    name, value, std, unit = what
    n, (before, cost) = len(recordings), costs
    after: AbstractForceEstimator = with_setting(estimator, name, value)
    counted = name == "lam"
    return Tuned(
        estimators=(after,) * n,
        models=(model,) * n,
        late=({},) * n,
        values={name: value},
        start={name: number_at(estimator, name)},
        std={name: std},
        units={name: unit},
        correlation=correlation_of([name], np.ones((1, 1))),
        chosen={},
        cost=cost,
        before=before,
        measured=int(sum(np.isfinite(r["y"].values).sum() for r in recordings)) * counted,
        doubts=tuple(doubts),
        held_out=None,
        profiles=None,
        history=xr.Dataset(
            {
                "cost": ("evaluation", [cost]),
                "passes": ("evaluation", [float(n)]),
                "value": (("evaluation", "name"), [[value]]),
            },
            coords={"name": [name]},
        ),
        choices=None,
        passes=float(n),
        converged=True,
    )


def _of(estimator: AbstractForceEstimator, model: Model, recording: xr.Dataset) -> _Found:
    if model.ny > 1:
        choice = lambda_from_sensors(estimator, model, recording)
        measured = np.isfinite(recording["y"].values).sum(axis=0)
        cost = 0.5 * (choice.table["error"] ** 2 @ xr.DataArray(measured, dims="output"))
        good = choice.table["as_good"].values
    else:
        choice = lambda_from_whiteness(estimator, model, recording)
        cost = 0.5 * choice.table["price"]
        good = cost.values <= cost.values.min() + AS_GOOD / 2
    lam, cost_of = choice.table["lam"].values, cost.values
    ends = np.log(lam[good])
    # The deviation of what may lie anywhere between two ends; at least that of the grid.
    step = float(np.abs(np.diff(np.log(lam))).max(initial=0.0))
    size = max(float(np.ptp(ends)), step) / np.sqrt(12)
    start = estimator.lam
    at, before = (int(np.abs(np.log(lam / value)).argmin()) for value in (choice.lam, start))
    return _Found(choice, size, float(cost_of[at]), float(cost_of[before]))
