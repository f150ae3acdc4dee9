"""Which recordings are missing, and how many of them make a piece of work."""

import dataclasses
import importlib.metadata
from collections.abc import Iterator, Mapping, Sequence

from backsight.fleet._changes import Changes
from backsight.fleet._recordings import FleetRecording
from backsight.fleet.fleet import Fleet, item_of
from backsight.fleet.items import Item, Work
from backsight.fleet.rows import Known, stamp_text
from backsight.run.estimation import Outputs

SECONDS = 2.0
"""Of a piece of work: long beside what it takes to hand it out, short enough to lose."""

LANES = 8
"""Recordings that advance together in the vectors of the widest processors."""

MOST = 512
"""Recordings of a piece of work at most."""

MOST_BYTES = 64_000_000
"""Of the files of a piece of work, beyond the first one: they are in memory at once."""


@dataclasses.dataclass(frozen=True)
class Order:
    """What does not change from one piece of work to the next."""

    text: str
    file: str
    keep: Outputs | None
    results: str
    outside: tuple[str, ...]
    env: tuple[str, ...]

    def work(self, setting: Changes, pieces: Sequence[Item]) -> Work:
        """Some recordings with a setting."""
        return Work(
            version=importlib.metadata.version("backsight"),
            text=self.text,
            file=self.file,
            setting=setting,
            pieces=tuple(pieces),
            keep=self.keep,
            results=self.results,
            outside=self.outside,
            env=self.env,
        )


class FleetPlan:
    """What is missing, cut into pieces of work as it is asked for.

    Their size follows from what recordings have cost so far, and towards the end from how many
    are left for each worker, so that all finish together.

    Parameters
    ----------
    missing : sequence of (setting, pieces)
        In the order in which they are done.
    order : Order
    """

    def __init__(self, missing: Sequence[tuple[Changes, Sequence[Item]]], order: Order) -> None:
        self._missing = [(setting, list(pieces)) for setting, pieces in missing if pieces]
        self._order = order
        self._place = 0
        self.left = sum(len(pieces) for _, pieces in self._missing)
        self._cost: float | None = None

    def learn(self, seconds: float) -> None:
        """Take in what a recording has cost [s]."""
        self._cost = seconds if self._cost is None else 0.7 * self._cost + 0.3 * seconds

    def next(self, slots: int) -> Work | None:
        """The next piece of work for one of so many workers; None if nothing is left."""
        if not self._missing:
            return None
        setting, pieces = self._missing[0]
        taken = pieces[self._place : self._place + self._size(slots)]
        taken = taken[: _fitting(taken)]
        self._place += len(taken)
        self.left -= len(taken)
        if self._place == len(pieces):
            self._missing.pop(0)
            self._place = 0
        return self._order.work(setting, taken)

    def alone(self, work: Work) -> list[Work]:
        """A piece of work again, every recording by itself."""
        return [self._order.work(work.setting, [piece]) for piece in work.pieces]

    def _size(self, slots: int) -> int:
        if self._cost is None:  # nothing is known yet
            return LANES
        by_cost = SECONDS / max(self._cost, 1e-6)
        if by_cost < 1 / LANES:  # even the lanes of one vector would take a minute
            return 1
        by_rest = -(-self.left // (2 * slots))
        size = min(by_cost, by_rest, MOST)
        return max(round(size / LANES), 1) * LANES


def _fitting(pieces: Sequence[Item]) -> int:
    """How many of them have files that go into memory together."""
    total, count = 0, 0
    for piece in pieces:
        total += sum(size for size, _ in piece.listed.stamp())
        if count and total > MOST_BYTES:
            break
        count += 1
    return count


def missing_of(fleet: Fleet, known: Mapping[str, Known]) -> Iterator[tuple[Changes, list[Item]]]:
    """Recordings by setting that are not in the store, or whose files look different now."""
    stamps = [stamp_text(listed.stamp()) for listed in fleet.recordings]
    for setting in fleet.settings:
        pieces = []
        for listed, stamp in zip(fleet.recordings, stamps, strict=True):
            item = item_of(listed, setting)
            there = known.get(item)
            if there is None or not there.digest:
                pieces.append(Item(item, listed))
            elif there.stamp != stamp:  # touched only, if the digest is the same
                pieces.append(Item(item, listed, there.digest))
        yield setting, pieces


def catalogued(fleet: Fleet) -> Iterator[tuple[str, int, int]]:
    """Every item with the numbers of its recording and its setting, recording by recording."""
    settings: list[Changes] = fleet.settings
    for k, listed in enumerate(fleet.recordings):
        for j, setting in enumerate(settings):
            yield item_of(listed, setting), k, j


def told_of(listed: FleetRecording) -> dict[str, object]:
    """A recording as the store keeps it."""
    return {
        "name": listed.name,
        "path": listed.path,
        "changes": dict(listed.changes),
        "metadata": dict(listed.metadata),
    }
