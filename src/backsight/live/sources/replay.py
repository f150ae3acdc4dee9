"""A recording that is played as if it were measured now."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from backsight.live.sources.base import Batch, LiveSource
from backsight.problem.reading.tables import ReplayFeed

if TYPE_CHECKING:
    import xarray as xr

_AT_ONCE = 4096
"""Samples that are taken at once where it shall go as fast as possible."""


class ReplaySource(LiveSource):
    """A recording; its signals are physical already.

    Parameters
    ----------
    name, feed
    read : callable
        Gives the recording.
    """

    stamped = True

    def __init__(self, name: str, feed: ReplayFeed, read: Callable[[], xr.Dataset]) -> None:
        super().__init__(name, feed)
        self.signals: list[str] = []
        self._read, self._speed, self._next = read, feed.speed, 0

    def open(self) -> None:
        """See `LiveSource.open`."""
        recording = self._read()
        self._time = recording["time"].values
        self._values = np.hstack(
            [self._time[:, None], recording["u"].values, recording["y"].values]
        )
        self.signals = [*map(str, recording["input"].values), *map(str, recording["output"].values)]

    def start(self) -> None:
        """See `LiveSource.start`."""
        self._began = time.time()
        self.state = "plays"

    def take(self) -> Batch | None:
        """See `LiveSource.take`."""
        first, now = self._next, time.time()
        if self._speed:
            due = self._time[0] + (now - self._began) * self._speed
            stop = int(np.searchsorted(self._time, due, side="right"))
        else:
            stop = min(first + _AT_ONCE, len(self._time))
        self._next = max(stop, first)
        if self._next == len(self._time):
            self.state, self.ended = "has ended", True
        if self._next == first:
            return None
        values = self._values[first : self._next]
        if self._speed:
            arrival = self._began + (values[:, 0] - self._time[0]) / self._speed
        else:
            arrival = np.full(len(values), now)
        return Batch(arrival, values)

    def stop(self) -> None:
        """See `LiveSource.stop`."""
        self.ended = True
