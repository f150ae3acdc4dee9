"""A run: sources, clock, estimator and store, one round after the other."""

import functools
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from backsight.live._freezing import Freezer
from backsight.live._lanes import Lane
from backsight.live._nis import with_nis
from backsight.live._problem import LiveProblem
from backsight.live._sinks import Sinks
from backsight.live.alarms import Alarms
from backsight.live.clock import TimeGrid
from backsight.live.engine import LiveEstimation, LiveRows
from backsight.live.sources import Batch
from backsight.live.store import Keeper, checkpoint_bytes

MOST_TOLD = 20
"""Reasons for which payloads of a source cannot be read that are told; all are counted."""

_NUMBER = re.compile(r"[-+\d.]+")
_LOST, _FOUND = "tries again", ("reads", "listens", "plays")
"""How states of a source end that has lost what it reads, and begin when it has it."""


class LiveSession:
    """A run, see `backsight.live._opening.opened_session`.

    Parameters
    ----------
    live : LiveProblem
    lanes : list of Lane
    grid : TimeGrid
    estimation : LiveEstimation
    keeper : Keeper, optional
    tell : callable
        Told, a sentence at a time, what the user should know.
    """

    def __init__(
        self,
        live: LiveProblem,
        lanes: list[Lane],
        grid: TimeGrid,
        estimation: LiveEstimation,
        *,
        keeper: Keeper | None,
        tell: Callable[[str], None],
    ) -> None:
        self.live, self.lanes, self.grid, self.estimation = live, lanes, grid, estimation
        self.keeper, self.tell = keeper, tell
        self._reorder = round(live.settings.reorder / grid.dt)
        self._shown = estimation.done
        self._lost: set[str] = set()
        self._told_faults: dict[str, set[str]] = {lane.name: set() for lane in lanes}
        self._arrived = time.monotonic()
        self.newest: LiveRows | None = None
        """Samples of the last round in which there were any."""
        self.alarms: Alarms | None = None
        self.sinks: Sinks | None = None
        self.freezer: Freezer | None = None
        self.labels: Mapping[str, Sequence[str]] = {}
        """Names along dimensions of the estimator's own, by variable."""
        self.listeners: list[Callable[[LiveRows], None]] = []
        """Told the newest samples of every round."""
        self.sensors = sum(s.dummy is None for s in live.model.outputs)
        self.latencies: list[float] = []
        """From the arrival of the oldest sample of a round to its estimates [s]; of new rounds."""

    @property
    def ended(self) -> bool:
        """Whether no source has anything more to say."""
        return all(lane.source.ended for lane in self.lanes)

    def round(self) -> bool:
        """Take in what came, estimate it, hand it on; whether anything came."""
        was_last = self.ended
        oldest = np.inf
        for lane in self.lanes:
            batch = lane.source.take()
            if self.keeper is not None:
                self.keeper.keep(lane.source)
            self._tell_faults(lane)
            self._tell_state(lane)
            if batch is not None:
                oldest = min(oldest, float(batch.arrival[0]))
                self._take_in(lane, batch)
        came = bool(np.isfinite(oldest))
        if came:
            self._arrived = time.monotonic()
        self._estimate(at_once=was_last)
        if came:
            self.latencies.append(time.time() - oldest)
        if self.keeper is not None:
            self.keeper.tick(self._checkpoint, self._acknowledging)
        elif came:
            self._acknowledging()()
        return came

    def _take_in(self, lane: Lane, batch: Batch) -> None:
        before = self.grid.newest
        for placed in lane.take_in(batch, self.estimation):
            if placed.leap:
                self._leap(before, int(placed.slots.min()))
            lane.put(placed, self.estimation)
            before = max(before, int(placed.slots.max()))
        if lane.too_fast is not None:
            self.tell(
                f"source {lane.name} sends {lane.too_fast:.4g} samples a second, faster than "
                f"live.dt takes them ({1 / self.grid.dt:.4g}): one in a period is used, the others "
                "are counted as duplicates"
            )
            lane.too_fast = None
        if lane.changed_rate is not None:
            before, now = lane.changed_rate
            self.tell(f"source {lane.name} sends {now:.4g} samples a second, before {before:.4g}")
            lane.changed_rate = None
        if lane.placing.set_back and not lane.replayed:
            moved = lane.set_clock()
            self.tell(f"source {lane.name}: its clock was set back; {moved:.6g} s are added now")

    def _leap(self, newest: int, slot: int) -> None:
        """Begin anew after a gap that is too long for the model to bridge."""
        self.tell(
            f"nothing was measured for {(slot - newest) * self.grid.dt:.6g} s, longer than "
            "live.bridge: the estimator begins anew"
        )
        self.estimation.advance(newest + 1, at_once=True)
        self._keep(self.estimation.settle(all_of_it=True))
        self.estimation.begin_anew(slot)
        for lane in self.lanes:
            lane.leap()
        self._shown = self.estimation.done

    def _estimate(self, *, at_once: bool) -> None:
        estimation, grid = self.estimation, self.grid
        if grid.newest < 0:
            return
        idle = time.monotonic() - self._arrived > self.live.settings.reorder + 0.05
        stop = grid.newest + 1 - (0 if at_once or idle else self._reorder)
        estimation.advance(stop, at_once=at_once)
        rows = estimation.newest(self._shown)
        if len(rows):
            self.newest, self._shown = with_nis(rows), rows.start + len(rows)
            if self.freezer is not None:
                self.freezer.look(self.newest)
            if self.alarms is not None:
                self.alarms.see(self.newest, lambda slot: float(self.grid.time(slot)))
            if self.sinks is not None:
                slots = np.arange(rows.start, rows.start + len(rows))
                self.sinks.send(self.newest, self.grid.time(slots))
            for listener in self.listeners:
                listener(self.newest)
        self._keep(estimation.settle())

    def _keep(self, rows: LiveRows) -> None:
        if self.keeper is not None:
            self.keeper.add(with_nis(rows))

    def close(self) -> None:
        """Estimate and store what is there."""
        for lane in self.lanes:
            lane.source.stop()
        self.round()
        self._estimate(at_once=True)
        self._keep(self.estimation.finish())
        if self.keeper is not None:
            self.keeper.close(self._checkpoint, self._acknowledging)
        if self.alarms is not None:
            self.alarms.close()
        if self.sinks is not None:
            self.sinks.close()

    def _checkpoint(self) -> Callable[[], bytes]:
        """Copy what must be kept; to pack that takes longer than a round should."""
        clocks = {lane.name: lane.clock.shift for lane in self.lanes}
        held = {name: rows for lane in self.lanes for name, rows in lane.kept().items()}
        return functools.partial(
            checkpoint_bytes,
            self.estimation.checkpoint(),
            origin=self.grid.origin or 0.0,
            newest=self.grid.newest,
            clocks=json.dumps(clocks),
            held=held,
        )

    def _acknowledging(self) -> Callable[[], None]:
        """What is to be called when all that was taken so far is stored."""
        marks = [(lane.source, lane.source.mark()) for lane in self.lanes]

        def acknowledge() -> None:
            for source, mark in marks:
                source.acknowledge(mark)

        return acknowledge

    def _tell_faults(self, lane: Lane) -> None:
        """Show the first payload of a source that cannot be read, and of every other reason."""
        source, told = lane.source, self._told_faults[lane.name]
        lane.placing.counts.malformed = source.malformed
        for fault in source.faults:
            kind = _NUMBER.sub("", fault.reason)
            if kind in told or len(told) == MOST_TOLD:
                continue
            shown = repr(fault.payload[:80].decode(errors="replace"))
            words = f"refuses {shown}, too" if told else f"cannot read {shown}"
            told.add(kind)
            self.tell(f"source {lane.name}: {words}: {fault.reason}")
        source.faults.clear()

    def _tell_state(self, lane: Lane) -> None:
        """Say once that a source has lost what it reads, and once that it has it again."""
        state = lane.source.state
        if lane.name not in self._lost and state.endswith(_LOST):
            self._lost.add(lane.name)
            self.tell(f"source {lane.name}: {state}")
        elif lane.name in self._lost and state.startswith(_FOUND):
            self._lost.remove(lane.name)
            self.tell(f"source {lane.name}: {state} again")
