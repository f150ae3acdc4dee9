"""Settings that are whole numbers or words: successive halving.

All combinations are tried on a part of long recordings, the better half on twice as much, and so on
(Karnin, Koren, Somekh, "Almost optimal exploration in multi-armed bandits", ICML 2013). Options
that inputs can be (`_lanes`) share a program: of ten weights and three horizons there are three.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.errors import BacksightError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.tune.fitting._objective import Runner, width_of
from backsight.tune.fitting.criteria import AbstractCriterion, Piece
from backsight.tune.fitting.runners import Data, Rebuilt, able_settings, lanes_of
from backsight.tune.fitting.values import Choice, LogScale, Unknown, with_setting
from backsight.types import Array

LEAST = 300
"""Samples of the first round at least."""

AT_ONCE = 20_000
"""Samples of all programs together that are run without halving: a beginning may not show what the
whole recording is about."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An estimator with one option of every choice.

    Parameters
    ----------
    options : tuple
    estimator : AbstractEstimator
    number : tuple of float
        Those of the options that are numbers which inputs can be.
    family : int
        Candidates of a family differ in these numbers only.
    """

    options: tuple[object, ...]
    estimator: AbstractEstimator
    number: tuple[float, ...] = ()
    family: int = 0


def candidates_of(estimator: AbstractEstimator, choices: Sequence[Choice]) -> list[Candidate]:
    """All combinations.

    Raises
    ------
    TuningError
        If a name is no field, or an option is refused.
    """
    able = able_settings(estimator)
    open_to_inputs = [c.name in able and all(_positive(o) for o in c.options) for c in choices]
    families: dict[tuple[str, ...], int] = {}
    found = []
    for options in itertools.product(*(c.options for c in choices)):
        changed = estimator
        for choice, option in zip(choices, options, strict=True):
            try:
                changed = with_setting(changed, choice.name, option)
            except (TypeError, AttributeError):
                raise TuningError(f"{estimator.title} has no setting '{choice.name}'") from None
        pairs = list(zip(options, open_to_inputs, strict=True))
        number = tuple(float(o) for o, opens in pairs if opens)  # type: ignore[arg-type]
        rest = tuple(repr(o) for o, opens in pairs if not opens)
        family = families.setdefault(rest, len(families))
        found.append(Candidate(options, changed, number, family))
    return found


def _positive(option: object) -> bool:
    return isinstance(option, int | float) and not isinstance(option, bool) and option > 0


@dataclasses.dataclass(frozen=True)
class Halving:
    """What candidates are judged by.

    Parameters
    ----------
    names : tuple of str
        Of the choices that are numbers which inputs can be.
    model : Model
    periods : tuple of float
        Sampling periods of the recordings.
    criterion : AbstractCriterion
    programs : dict
        Those made so far, by family and sampling period.
    """

    names: tuple[str, ...]
    model: Model
    periods: tuple[float, ...]
    criterion: AbstractCriterion
    programs: dict[tuple[int, float], Runner] = dataclasses.field(default_factory=dict)

    def costs(self, family: Sequence[Candidate], parts: Sequence[Data]) -> list[float]:
        """Cost of candidates of one family for a judged measurement; infinite if they fail."""
        total, count = np.zeros(len(family)), 0
        for part, dt in zip(parts, self.periods, strict=True):
            try:
                total += self._cost(family, part, dt)
            except BacksightError:
                return [np.inf] * len(family)
            count += int((part[4] > 0).sum())
        return [float(c) for c in total / max(count, 1)]

    def _cost(self, family: Sequence[Candidate], part: Data, dt: float) -> Array:
        settings = [dict(zip(self.names, c.number, strict=True)) for c in family]
        pieces = list(self._program(family, dt).innovations(part, settings))
        judged, width = part[4] > 0, width_of(part)
        costs = []
        for i in range(len(family)):
            alone, start = [], 0
            for r, d in pieces:
                stop = start + r.shape[1]
                alone.append(Piece(r[i : i + 1], d[i : i + 1], judged[start:stop], width))
                start = stop
            costs.append(self.criterion.measure(alone, 1.0).cost)
        return np.array(costs)

    def _program(self, family: Sequence[Candidate], dt: float) -> Runner:
        """What runs a family: with numbers as inputs, or built for its only member."""
        first = family[0]
        key = first.family, dt
        if key not in self.programs:
            ahead = self.criterion.alone
            unknowns = tuple(
                Unknown(name, "setting", name, LogScale(number), 1.0, "all")
                for name, number in zip(self.names, first.number, strict=True)
            )
            # A program of lanes pays if it runs more than one candidate.
            lanes = None
            if unknowns:
                lanes = lanes_of(first.estimator, self.model, dt, unknowns, ahead=ahead)
            rebuilt = Rebuilt(first.estimator, self.model, unknowns, dt, ahead)
            self.programs[key] = lanes or rebuilt
        return self.programs[key]


def halve(
    candidates: Sequence[Candidate], halving: Halving, data: Sequence[Data]
) -> tuple[Candidate, xr.Dataset]:
    """Return the best, and what every one cost a sample in the last round that it was in."""
    left, rounds = list(range(len(candidates))), int(np.ceil(np.log2(len(candidates))))
    if len({c.family for c in candidates}) * sum(len(d[0]) for d in data) <= AT_ONCE:
        rounds = 0
    skipped = max(c.estimator.horizon for c in candidates) + halving.criterion.alone
    cost = np.full(len(candidates), np.inf)
    used = np.zeros(len(candidates), int)
    for number in range(rounds + 1):
        share = 2.0 ** (number - rounds)
        parts = [_first(d, max(round(share * len(d[0])), LEAST + skipped), skipped) for d in data]
        for family in _families(candidates, left):
            cost[family] = halving.costs([candidates[i] for i in family], parts)
            used[family] = sum(len(p[0]) for p in parts)
        left = sorted(left, key=lambda i: cost[i])[: max(len(left) // 2, 1)]
        if not np.isfinite(cost[left[0]]):
            raise TuningError("every option fails on the recording: start nearer to the truth")
    table = xr.Dataset(
        {"cost": ("option", cost), "samples": ("option", used)},
        coords={"option": [", ".join(map(str, c.options)) for c in candidates]},
    )
    return candidates[left[0]], table


def _families(candidates: Sequence[Candidate], left: Sequence[int]) -> list[list[int]]:
    """Places of candidates, family by family."""
    found: dict[int, list[int]] = {}
    for i in sorted(left):
        found.setdefault(candidates[i].family, []).append(i)
    return list(found.values())


def _first(data: Data, samples: int, skipped: int) -> Data:
    u, y, mask, y_all, mask_all = (a[:samples] for a in data)
    judged: Array = mask_all.copy()
    judged[:skipped] = 0
    return u, y, mask, y_all, judged
