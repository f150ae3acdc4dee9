"""The weight of sparse forces as a value of a fit: what other sensors say, or what is left over."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.tune.fitting.tuned import Tuned, correlation_of
from backsight.tune.fitting.values import with_setting
from backsight.tune.lambda_choice import LambdaChoice, lambda_from_sensors, lambda_from_whiteness

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
    start = float(getattr(estimator, "lam", np.nan))
    after: AbstractForceEstimator = with_setting(estimator, "lam", lam)
    doubts = [
        f"the weight of recording {i + 1} is the best of those tried, but no good one: the model "
        "is wrong, or the noise is not as stated"
        for i, f in enumerate(found)
        if not f.choice.reached
    ]
    return Tuned(
        estimators=(after,) * n,
        models=(model,) * n,
        late=({},) * n,
        values={"lam": lam},
        start={"lam": start},
        std={"lam": lam * size},
        units={"lam": ""},
        correlation=correlation_of(["lam"], np.array([[max(size, 1e-12) ** 2]])),
        chosen={},
        cost=sum(f.cost for f in found),
        before=sum(f.before for f in found),
        measured=int(sum(np.isfinite(r["y"].values).sum() for r in recordings)),
        doubts=tuple(doubts),
        held_out=None,
        profiles=None,
        history=xr.Dataset(
            {
                "cost": ("evaluation", [sum(f.cost for f in found)]),
                "passes": ("evaluation", [float(n)]),
                "value": (("evaluation", "name"), [[lam]]),
            },
            coords={"name": ["lam"]},
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
    start = float(getattr(estimator, "lam", choice.lam))
    at, before = (int(np.abs(np.log(lam / value)).argmin()) for value in (choice.lam, start))
    return _Found(choice, size, float(cost_of[at]), float(cost_of[before]))
