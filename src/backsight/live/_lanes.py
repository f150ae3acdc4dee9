"""A source with its clock and its counts: from what arrives to values in slots."""

import collections
import time
from collections.abc import Mapping

import numpy as np

from backsight.errors import ProblemError
from backsight.live._freezing import SEEN
from backsight.live._problem import Channels, LiveProblem, channels_of
from backsight.live.clock import DelayLine, Placed, Placing, SourceClock, TimeGrid
from backsight.live.engine import LiveEstimation
from backsight.live.sources import Batch, LiveSource
from backsight.live.sources.replay import ReplaySource
from backsight.types import Array

_STEPS, _FAST = 10, 0.7
"""Steps from which a rate is judged, and their share of a period below which it is too high."""

_LINE = "line:"
"""In front of the names of what delays hold back."""

_RATE_OVER = 5.0
"""Seconds over which a rate is told."""

_STEADY, _OTHER = 50, 1.5
"""Steps of a source's own clock that make a rate, and the factor from which it is another one."""


class Lane:
    """What a source brings, on the way to the rows.

    Parameters
    ----------
    source : LiveSource
    live : LiveProblem
    grid : TimeGrid
    """

    def __init__(self, source: LiveSource, live: LiveProblem, grid: TimeGrid) -> None:
        self.source, self._live, self._grid = source, live, grid
        feed = source.feed
        self.clock = SourceClock(own=feed.clock == "own", delay=feed.delay, dt=grid.dt)
        self.placing = Placing(grid)
        self.replayed = isinstance(source, ReplaySource)
        self._channels: Channels | None = None
        self._arrived: collections.deque[tuple[float, int]] = collections.deque()
        self.last_arrival: float | None = None
        self.began = time.time()
        self._last_time = 0.0
        self.too_fast: float | None = None
        """Samples per second, when they are more than the grid has and this was not told."""
        self.changed_rate: tuple[float, float] | None = None
        """Samples per second before and now, when they have changed and this was not told."""
        self._steps: collections.deque[float] = collections.deque(maxlen=_STEADY)
        self._period: float | None = None
        self._told_rate, self._times = False, np.empty(0)
        self.lines: dict[float, DelayLine] = {}
        """Of channels that are late by a fraction of a sample, by their delays."""
        self.gaps = 0
        """How often it was silent."""
        self.worst_lateness = 0.0
        """Largest time that a sample came after a newer one [s]."""

    @property
    def name(self) -> str:
        """Name of the source."""
        return self.source.name

    @property
    def channels(self) -> Channels:
        """Which of its columns are which signals; known when it has begun."""
        if self._channels is None:
            self._channels = self._found()
        return self._channels

    def _found(self) -> Channels:
        model, feed = self._live.model, self.source.feed
        if not isinstance(self.source, ReplaySource):
            return channels_of(
                self.name, feed, self._live, self._grid.dt, columns=self.source.columns
            )
        signals = self.source.signals
        names = [
            *(s.name for s in model.inputs if not s.name.startswith(SEEN)),
            *(s.name for s in model.outputs if s.dummy is None),
        ]
        absent = [n for n in names if n not in signals]
        if absent and feed.columns_wanted:
            names = [n for n in names if n in signals]
        elif absent:
            raise ProblemError(f"source.{self.name}: the recording has no '{absent[0]}'")
        nu = model.nu
        outputs = [s.name for s in model.outputs]
        inputs = [s.name for s in model.inputs]
        places = [inputs.index(n) if n in inputs else nu + outputs.index(n) for n in names]
        columns = [1 + signals.index(n) for n in names]
        one = np.ones(len(names))
        return Channels(tuple(places), tuple(columns), one, 0 * one, 0 * one)

    def take_in(self, batch: Batch, estimation: LiveEstimation) -> list[Placed]:
        """Times, units and slots of what came; what cannot be used is counted."""
        feed, counts = self.source.feed, self.placing.counts
        counts.received += len(batch.arrival)
        if self.last_arrival is not None:
            gap = float(batch.arrival[0]) - self.last_arrival
            self.gaps += gap > feed.silent
        self.last_arrival = float(batch.arrival[-1])
        self._arrived.append((self.last_arrival, len(batch.arrival)))
        if self.replayed:
            times = batch.values[:, 0]
        else:
            stamps = np.full(len(batch.arrival), np.nan)
            if self.source.stamped:
                stamps = batch.values[:, 0]
            elif feed.time is not None:
                factor = 1.0 if feed.time.factor is None else feed.time.factor
                stamps = batch.values[:, 0] * factor + feed.time.offset
            times = self.clock.common(stamps, batch.arrival)
        if feed.time is not None and not self.replayed:
            self._look_at_period(times)
        self._last_time = float(times[-1])
        self._times = times
        if self._grid.newest >= 0:
            behind = float(self._grid.time(self._grid.newest)) - float(times.min())
            self.worst_lateness = max(self.worst_lateness, behind)
        values = self.channels.physical(batch.values)
        return self.placing.place(times, values, base=estimation.base, now=self.last_arrival)

    def _look_at_rate(self, duplicates: int) -> None:
        """See whether samples come faster than the grid takes them; of each period one is used."""
        steps = np.diff(np.unique(self._times))
        if self._told_rate or not duplicates or len(steps) < _STEPS:
            return
        period = float(np.median(steps))
        if period < _FAST * self._grid.dt:
            self.too_fast, self._told_rate = 1 / period, True

    def _look_at_period(self, times: Array) -> None:
        """See whether the source has begun to send at another rate.

        Its own clock tells: what waits on the way comes in bursts. Single samples that are late,
        and gaps, move no quantile; a source that sends when it likes has no rate.
        """
        steps = np.diff(np.r_[self._last_time, times])
        self._steps.extend(steps[steps > 0].tolist())
        if len(self._steps) < _STEADY:
            return
        short, period, long = np.quantile(self._steps, [0.2, 0.5, 0.8]).tolist()
        if long > _OTHER * short:
            return
        if self._period is not None and not 1 / _OTHER < period / self._period < _OTHER:
            self.changed_rate = 1 / self._period, 1 / period
            self._steps.clear()
        if self._period is None or self.changed_rate is not None:
            self._period = period

    def put(self, placed: Placed, estimation: LiveEstimation) -> None:
        """Put values into their rows; a channel that is late goes to the row of its time."""
        channels, counts = self.channels, self.placing.counts
        used = np.zeros(len(placed.slots), bool)
        for delay in np.unique(channels.delays):
            chosen = np.flatnonzero(channels.delays == delay)
            places = [channels.places[k] for k in chosen]
            values = placed.values[:, chosen]
            if delay == round(delay):
                duplicates, changed = self._moved(
                    places, placed.slots - int(delay), values, estimation
                )
            else:
                line = self.lines.setdefault(delay, DelayLine.of(delay, len(places)))
                slots, moved, duplicates, changed = line.through(
                    placed.slots, values, base=estimation.base
                )
                estimation.put(places, slots, moved)
            counts.duplicates += duplicates
            self._look_at_rate(duplicates)
            used |= changed
        counts.late += int((used & (placed.slots < estimation.done)).sum())

    def _moved(
        self, places: list[int], slots: np.ndarray, values: Array, estimation: LiveEstimation
    ) -> tuple[int, np.ndarray]:
        """Put values into the rows of slots; duplicates, and which samples were new."""
        there = slots >= estimation.base
        self.placing.counts.too_late += int((~there).sum())
        duplicates, put = estimation.put(places, slots[there], values[there])
        changed = there.copy()
        changed[there] = put
        return duplicates, changed

    def kept(self) -> dict[str, Array]:
        """What the delays of its channels hold back, by a name for each."""
        return {f"{_LINE}{self.name}:{d}": line.kept() for d, line in self.lines.items()}

    def go_on(self, kept: Mapping[str, Array]) -> None:
        """Take over what was kept."""
        delays = self.channels.delays
        for delay in np.unique(delays):
            if (found := kept.get(f"{_LINE}{self.name}:{delay}")) is not None:
                self.lines[delay] = DelayLine.of(delay, int((delays == delay).sum()))
                self.lines[delay].go_on(found)

    def leap(self) -> None:
        """What comes next is of another time."""
        for line in self.lines.values():
            line.forget()

    def rate(self, now: float) -> float:
        """Samples per second over the last seconds."""
        while self._arrived and self._arrived[0][0] < now - _RATE_OVER:
            self._arrived.popleft()
        span = min(_RATE_OVER, max(now - self.began, 1e-3))
        return sum(n for _, n in self._arrived) / span

    def silent_for(self, now: float) -> float:
        """Seconds since the last sample."""
        return now - (self.last_arrival or self.began)

    def silent(self, now: float) -> bool:
        """Whether nothing came for too long."""
        return not self.source.ended and self.silent_for(now) > self.source.feed.silent

    def set_clock(self) -> float:
        """Put a clock that was set back to where it would be; by how many seconds."""
        moved = float(self._grid.time(self._grid.newest + 1)) - self._last_time
        self.clock.shift = (self.clock.shift or 0.0) + moved
        self.placing.forget()
        return moved
