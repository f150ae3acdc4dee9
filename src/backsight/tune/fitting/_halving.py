"""Settings that are whole numbers or words: successive halving.

All combinations are tried on a part of the recordings, the better half on twice as much, and so on
(Karnin, Koren, Somekh, "Almost optimal exploration in multi-armed bandits", ICML 2013).
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.errors import BacksightError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.tune.fitting._lanes import Data
from backsight.tune.fitting._objective import width_of
from backsight.tune.fitting._rebuilt import Rebuilt
from backsight.tune.fitting.criteria import AbstractCriterion, Piece
from backsight.tune.fitting.values import Choice, with_setting
from backsight.types import Array

LEAST = 300
"""Samples of the first round at least."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An estimator with one option of every choice."""

    options: tuple[object, ...]
    estimator: AbstractEstimator


def candidates_of(estimator: AbstractEstimator, choices: Sequence[Choice]) -> list[Candidate]:
    """All combinations.

    Raises
    ------
    TuningError
        If a name is no field, or an option is refused.
    """
    found = []
    for options in itertools.product(*(c.options for c in choices)):
        changed = estimator
        for choice, option in zip(choices, options, strict=True):
            try:
                changed = with_setting(changed, choice.name, option)
            except (TypeError, AttributeError):
                raise TuningError(f"{estimator.title} has no setting '{choice.name}'") from None
        found.append(Candidate(options, changed))
    return found


def halve(
    candidates: Sequence[Candidate],
    model: Model,
    data: Sequence[Data],
    periods: Sequence[float],
    criterion: AbstractCriterion,
) -> tuple[Candidate, xr.Dataset]:
    """Return the best, and what every one cost a sample in the last round that it was in."""
    left, rounds = list(range(len(candidates))), int(np.ceil(np.log2(len(candidates))))
    skipped = max(c.estimator.horizon for c in candidates)
    cost = np.full(len(candidates), np.inf)
    used = np.zeros(len(candidates), int)
    for number in range(rounds + 1):
        share = 2.0 ** (number - rounds)
        parts = [_first(d, max(round(share * len(d[0])), LEAST + skipped), skipped) for d in data]
        for i in left:
            cost[i] = _cost(candidates[i].estimator, model, parts, periods, criterion)
            used[i] = sum(len(p[0]) for p in parts)
        left = sorted(left, key=lambda i: cost[i])[: max(len(left) // 2, 1)]
        if not np.isfinite(cost[left[0]]):
            raise TuningError("every option fails on the recording: start nearer to the truth")
    table = xr.Dataset(
        {"cost": ("option", cost), "samples": ("option", used)},
        coords={"option": [", ".join(map(str, c.options)) for c in candidates]},
    )
    return candidates[left[0]], table


def _first(data: Data, samples: int, skipped: int) -> Data:
    u, y, mask, y_all, mask_all = (a[:samples] for a in data)
    judged: Array = mask_all.copy()
    judged[:skipped] = 0
    return u, y, mask, y_all, judged


def _cost(
    estimator: AbstractEstimator,
    model: Model,
    data: Sequence[Data],
    periods: Sequence[float],
    criterion: AbstractCriterion,
) -> float:
    """Cost a judged measurement; infinite if the estimator fails."""
    total, count = 0.0, 0
    for part, dt in zip(data, periods, strict=True):
        try:
            (found,) = Rebuilt(estimator, model, (), dt).innovations(part, [{}])
        except BacksightError:
            return np.inf
        judged = part[4] > 0
        total += criterion.measure([Piece(*found, judged, width_of(part))], 1.0).cost
        count += int(judged.sum())
    return total / max(count, 1)
