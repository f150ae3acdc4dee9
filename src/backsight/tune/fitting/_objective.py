"""The criterion over all recordings as a function of all values, with their prior."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from backsight.tune.fitting.criteria import AbstractCriterion, Measure, Piece
from backsight.tune.fitting.runners import Data
from backsight.tune.fitting.values import Unknown
from backsight.types import Array


class Runner(Protocol):
    """Whatever runs an estimator with several settings."""

    def innovations(
        self, data: Data, settings: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[Array, Array]]:
        """Innovations and variances (lanes, n, ny), piece by piece."""
        ...


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """One number that is searched: an unknown, of all recordings or of some."""

    name: str
    unknown: Unknown
    recordings: tuple[int, ...]


def coordinates_of(unknowns: Sequence[Unknown], recordings: int) -> tuple[Coordinate, ...]:
    """Numbers to search; those of groups and single recordings have them in brackets."""
    found = []
    for u in unknowns:
        if u.per == "all":
            found.append(Coordinate(u.name, u, tuple(range(recordings))))
            continue
        groups = [str(i + 1) for i in range(recordings)] if u.per == "recording" else list(u.per)
        for group in dict.fromkeys(groups):
            members = tuple(i for i, g in enumerate(groups) if g == group)
            found.append(Coordinate(f"{u.name}[{group}]", u, members))
    return tuple(found)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The objective at a place.

    Parameters
    ----------
    cost, gradient, curvature
        With the prior.
    data : Measure
        Without it.
    """

    cost: float
    gradient: Array
    curvature: Array
    data: Measure


@dataclasses.dataclass(frozen=True)
class Objective:
    """Criterion and prior at places on the scales.

    Parameters
    ----------
    runners : tuple of Runner
        One for every recording.
    data : tuple of Data
    coordinates : tuple of Coordinate
    criterion : AbstractCriterion
    step : float
        Difference on the scales by which derivatives are taken.
    fast : bool
        Whether derivatives run in lanes, at next to no price.
    """

    runners: tuple[Runner, ...]
    data: tuple[Data, ...]
    coordinates: tuple[Coordinate, ...]
    criterion: AbstractCriterion
    step: float
    fast: bool

    @property
    def precision(self) -> Array:
        """Inverse variances of the prior."""
        return np.array([c.unknown.spread**-2 for c in self.coordinates])

    @property
    def samples(self) -> int:
        """Samples of one pass."""
        return sum(len(d[0]) for d in self.data)

    def cut(self, share: slice | Callable[[int], slice]) -> "Objective":
        """The same for a part of every recording; what comes before it is run, not judged."""
        data = []
        for u, y, mask, y_all, mask_all in self.data:
            part = share if isinstance(share, slice) else share(len(u))
            first, stop, _ = part.indices(len(u))
            judged = mask_all[:stop].copy()
            judged[:first] = 0
            data.append((u[:stop], y[:stop], mask[:stop], y_all[:stop], judged))
        return dataclasses.replace(self, data=tuple(data))

    def values(self, place: Array, recording: int) -> dict[str, float]:
        """Values by name for a recording."""
        return {
            c.unknown.name: c.unknown.scale.value(float(t))
            for c, t in zip(self.coordinates, place, strict=True)
            if recording in c.recordings
        }

    def at(self, place: Array) -> Evaluation:
        """Cost, gradient and curvature at a place: one pass over all recordings."""
        p = len(self.coordinates)
        cost, gradient, curvature, scores = 0.0, np.zeros(p), np.zeros((p, p)), []
        for k in range(len(self.data)):
            mine = [i for i, c in enumerate(self.coordinates) if k in c.recordings]
            found = self.criterion.measure(self._pieces(k, place, mine), self.step)
            cost += found.cost
            gradient[mine] += found.gradient
            curvature[np.ix_(mine, mine)] += found.curvature
            wide = np.zeros((len(found.scores), p))
            wide[:, mine] = found.scores
            scores.append(wide)
        data = Measure(cost, gradient, curvature, np.concatenate(scores))
        weight = self.precision
        return Evaluation(
            cost + 0.5 * float(weight @ place**2),
            gradient + weight * place,
            curvature + np.diag(weight),
            data,
        )

    def cost_at(self, places: Sequence[Array]) -> list[float]:
        """Criterion without prior at several places, without derivatives."""
        costs = np.zeros(len(places))
        for k in range(len(self.data)):
            settings = [self.values(place, k) for place in places]
            pieces = list(self.runners[k].innovations(self.data[k], settings))
            for i in range(len(places)):
                alone = _cut([(r[i : i + 1], d[i : i + 1]) for r, d in pieces], self.data[k])
                costs[i] += self.criterion.measure(alone, self.step).cost
        return [float(c) for c in costs]

    def _pieces(self, k: int, place: Array, mine: Sequence[int]) -> Iterator[Piece]:
        settings = [self.values(place, k)]
        for i in mine:
            moved = place.copy()
            moved[i] += self.step
            settings.append(self.values(moved, k))
        yield from _cut(self.runners[k].innovations(self.data[k], settings), self.data[k])


def _cut(found: Iterable[tuple[Array, Array]], data: Data) -> Iterator[Piece]:
    """Innovations with what counts of them."""
    judged, width, start = data[4] > 0, width_of(data), 0
    for r, d in found:
        stop = start + r.shape[1]
        yield Piece(r, d, judged[start:stop], width)
        start = stop


def width_of(data: Data) -> Array:
    """Range of what was measured, (ny,)."""
    y, seen = data[3], data[4] > 0
    high = np.where(seen, y, -np.inf).max(axis=0)
    low = np.where(seen, y, np.inf).min(axis=0)
    width = np.where(high > low, high - low, 1.0)
    return np.where(np.isfinite(width), width, 1.0)
