"""Weight and threshold of sparse forces as values of a fit.

The weight is what noise can do, by its size in the recording; the threshold what noise does not
reach.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.tune.fitting.tuned import Tuned, correlation_of
from backsight.tune.fitting.values import number_at, with_setting
from backsight.tune.force_threshold import threshold_from_noise
from backsight.tune.lambda_scaled import scaled_noise

ALARM = 0.05
"""Share of recordings of noise in which a force may be shown."""

AS_STATED = 1.25
"""Factor by which the noise of a recording may differ from what is stated without a word."""

DRAWS = 400
"""Recordings of noise that are drawn for a weight."""


def tuned_weight(
    estimator: AbstractForceEstimator, model: Model, recordings: Sequence[xr.Dataset]
) -> Tuned:
    """Weight by what noise can do, with the size of the noise from the recording.

    See `lambda_from_scaled_noise`; the rest as `Tuned` has it. Several recordings have the mean of
    the logarithms of theirs. The standard deviation is that of the size of the noise, or the spread
    between recordings if it is larger.
    """
    found = [scaled_noise(estimator, model, r, draws=DRAWS, seed=0) for r in recordings]
    choices = [f.choice() for f in found]
    logs, n = np.log([c.lam for c in choices]), len(found)
    size = float(np.sqrt(np.mean([0.5 / f.measured + f.doubt**2 for f in found]) / n))
    if n > 1:
        size = max(size, float(logs.std(ddof=1)) / np.sqrt(n))
    lam = float(np.exp(logs.mean()))
    doubts = []
    for i, choice in enumerate(choices):
        scale = float(choice.table["scale"][-1])
        if not choice.reached:
            doubts.append(f"the weight of recording {i + 1} has not settled: take it with care")
        elif not 1 / AS_STATED < scale < AS_STATED:
            why = "or the model is wrong" if scale > 1 else "is larger than it need be"
            doubts.append(
                f"what forces leave of recording {i + 1} is {significant(scale, 2)} times the "
                f"noise that is stated, which the weight makes up for: sigma_y or sigma_force {why}"
            )
    return _tuned(
        ("lam", lam, lam * size, ""),
        estimator,
        model,
        recordings,
        costs=(sum(f.cost(estimator.lam) for f in found), sum(f.cost(lam) for f in found)),
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
