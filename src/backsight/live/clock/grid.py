"""From samples with times to slots of one even grid, with what is wrong about their times."""

import dataclasses

import numpy as np

from backsight.types import Array

SURE = 3
"""Successive samples that agree before a leap of the clock is believed."""

LATEST = 1e12
"""Seconds since 1970 that no clock shows."""


@dataclasses.dataclass
class TimeCounts:
    """What happened to the samples of a source.

    Parameters
    ----------
    received, malformed : int
        Samples that came, and payloads that could not be read.
    duplicates : int
        Values that were there already.
    late : int
        Samples that came after their turn and were used by going back.
    too_late : int
        Samples that came too late to be used.
    implausible : int
        Samples with times that cannot be.
    """

    received: int = 0
    malformed: int = 0
    duplicates: int = 0
    late: int = 0
    too_late: int = 0
    implausible: int = 0


@dataclasses.dataclass(frozen=True)
class Placed:
    """Samples by slots.

    Parameters
    ----------
    slots : (n,) array of int
    values : (n, m) array
    leap : bool
        Whether a gap lies before them that is too long to be bridged.
    """

    slots: np.ndarray
    values: Array
    leap: bool = False


class TimeGrid:
    """An even grid on the common clock, which begins a little before the first sample that comes.

    Parameters
    ----------
    dt : float
        Sampling period [s].
    bridge : int
        Longest gap in samples.
    before : int
        Slots in front of that of the first sample, for those that it has overtaken.
    origin : float, optional
        Time of slot 0 [s].
    """

    def __init__(
        self, dt: float, *, bridge: int, before: int = 0, origin: float | None = None
    ) -> None:
        self.dt, self.bridge, self.before, self.origin = dt, bridge, before, origin
        self.newest = -1
        """Newest slot that was seen."""

    def time(self, slot: int | np.ndarray) -> Array:
        """Time of slots [s]."""
        return (self.origin or 0.0) + self.dt * np.asarray(slot, float)

    def slots(self, times: Array) -> np.ndarray:
        """Nearest slots of times [s], (n,); such as cannot be are -1."""
        if self.origin is None:
            self.origin = float(times[0]) - self.before * self.dt
        found = np.rint((times - self.origin) / self.dt)
        sound = np.abs(found) < 2**53
        return np.where(sound, found, -1.0).astype(np.int64)


def _reached(slots: np.ndarray, newest: int, bridge: int) -> int:
    """Newest slot to which samples go on from another without a gap that is too long."""
    if slots.max() <= newest + bridge:
        return int(max(slots.max(), newest))
    steps = np.unique(np.append(slots[slots > newest], newest))
    gaps = np.flatnonzero(np.diff(steps) > bridge)
    return int(steps[gaps[0]] if len(gaps) else steps[-1])


class Placing:
    """The samples of one source: which are believed.

    Parameters
    ----------
    grid : TimeGrid
    """

    def __init__(self, grid: TimeGrid) -> None:
        self.grid, self.counts = grid, TimeCounts()
        self._doubtful: list[tuple[int, Array]] = []
        self._late_since: float | None = None
        self.set_back = False
        """Whether only samples from long ago came for a long time: the clock was set back."""

    def place(self, times: Array, values: Array, *, base: int, now: float) -> list[Placed]:
        """Slots of samples with these times (n,) that may be used, from slot `base` on.

        A sample beyond the longest gap waits until others say the same.
        """
        grid = self.grid
        finite = np.abs(times) < LATEST  # NaN is not below anything
        if not finite.all():
            self.counts.implausible += int((~finite).sum())
            times, values = times[finite], values[finite]
        if not len(times):
            return []
        slots = grid.slots(times)
        newest = max(grid.newest, base) if grid.newest >= 0 else int(slots[0])
        far = slots > _reached(slots, newest, grid.bridge)
        near = self._near(slots[~far], values[~far], base=base, now=now)
        if not far.any():
            self._doubtful.clear()
            return near
        beyond = self._believed(slots[far], values[far])
        return [*near, *beyond]

    def _near(self, slots: np.ndarray, values: Array, *, base: int, now: float) -> list[Placed]:
        """Those of samples that do not come too late."""
        if not len(slots):
            return []
        old = slots < base
        self.counts.too_late += int(old.sum())
        if not old.all():
            self._late_since = None
        elif self._late_since is None:
            self._late_since = now
        since = now if self._late_since is None else self._late_since
        self.set_back = now - since > self.grid.bridge * self.grid.dt
        if old.any():
            slots, values = slots[~old], values[~old]
        if not len(slots):
            return []
        self.grid.newest = max(self.grid.newest, int(slots.max()))
        return [Placed(slots, values)]

    def _believed(self, slots: np.ndarray, values: Array) -> list[Placed]:
        """Samples far ahead, when several in a row agree; they wait until then."""
        self.counts.implausible += len(slots)
        self._doubtful += [(int(s), v) for s, v in zip(slots, values, strict=True)]
        last = [s for s, _ in self._doubtful[-SURE:]]
        if len(last) < SURE or max(last) - min(last) > self.grid.bridge:
            del self._doubtful[:-SURE]
            return []
        agreeing = [(s, v) for s, v in self._doubtful if abs(s - last[-1]) <= self.grid.bridge]
        self._doubtful.clear()
        self.counts.implausible -= len(agreeing)
        self.grid.newest = max(s for s, _ in agreeing)
        found = np.array([s for s, _ in agreeing], np.int64)
        return [Placed(found, np.array([v for _, v in agreeing]), leap=True)]

    def forget(self) -> None:
        """Begin anew after the clock was set."""
        self._late_since, self.set_back = None, False
        self._doubtful.clear()
