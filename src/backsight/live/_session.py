"""A run: sources, clock, estimator and store, one round after the other."""

import contextlib
import dataclasses
import functools
import json
import time
from collections.abc import Callable, Iterator

import numpy as np
import xarray as xr

from backsight.description import digest
from backsight.engine.dense import UNROLL
from backsight.engine.execute import Engine
from backsight.errors import ProblemError
from backsight.live._lanes import Lane
from backsight.live._nis import with_nis
from backsight.live._problem import LiveProblem
from backsight.live.clock import TimeGrid
from backsight.live.engine import Checkpoint, LiveEstimation, LiveRows
from backsight.live.sources import Batch, source_of
from backsight.live.store.keeping import Keeper, checkpoint_bytes, column_units, columns_of
from backsight.live.store.writing import LiveStore, opened_live_store
from backsight.problem.reading.tables import FeedTable, RecordingTable, ReplayFeed
from backsight.problem.recorded import recording_of
from backsight.run.estimation import Outputs, Prepared, compile_once
from backsight.run.estimation.results.outputs import JUDGED

SHOWN = (*JUDGED, "z_hat", "z_std", "d_hat", "d_std", "weight")
"""Variables that are kept of every sample, where the estimator has them."""


class LiveSession:
    """A run, see `opened_session`.

    Parameters
    ----------
    live : LiveProblem
    dt : float
        Sampling period [s].
    lanes : list of Lane
    grid : TimeGrid
    estimation : LiveEstimation
    labels : dict
        Names along dimensions of the estimator's own.
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
        self._told_faults: set[str] = set()
        self._arrived = time.monotonic()
        self.newest: LiveRows | None = None
        """Samples of the last round in which there were any."""
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
            self._tell_faults(lane)
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

    def _checkpoint(self) -> bytes:
        clocks = {lane.name: lane.clock.shift for lane in self.lanes}
        return checkpoint_bytes(
            self.estimation.checkpoint(),
            origin=self.grid.origin or 0.0,
            newest=self.grid.newest,
            clocks=json.dumps(clocks),
        )

    def _acknowledging(self) -> Callable[[], None]:
        """What is to be called when all that was taken so far is stored."""
        marks = [(lane.source, lane.source.mark()) for lane in self.lanes]

        def acknowledge() -> None:
            for source, mark in marks:
                source.acknowledge(mark)

        return acknowledge

    def _tell_faults(self, lane: Lane) -> None:
        """Show the first payload of a source that cannot be read."""
        source = lane.source
        lane.placing.counts.malformed = source.malformed
        if source.faults and lane.name not in self._told_faults:
            self._told_faults.add(lane.name)
            fault = source.faults[0]
            shown = fault.payload[:80].decode(errors="replace")
            self.tell(f"source {lane.name}: cannot read {shown!r}: {fault.reason}")
        source.faults.clear()


@contextlib.contextmanager
def opened_session(
    live: LiveProblem, *, tell: Callable[[str], None], engine: Engine = "native"
) -> Iterator[LiveSession]:
    """Start a run: compile, open the store, go on from its last part, start the sources.

    Raises
    ------
    ProblemError, DataError
        If something that is needed is missing.
    OutputError
        If a port is taken, or the store cannot be used.
    PluginError
        If a package is not installed.
    """
    with contextlib.ExitStack() as stack:
        dt = _period(live)
        prepared = compiled_live(live, dt)
        store = checkpoint = None
        if live.store is not None:
            folder = live.problem.path.parent / live.store.path
            said = digest(live.estimator, live.model, dt)
            store = stack.enter_context(opened_live_store(folder, said=said))
            checkpoint = store.checkpoint()
        bridge = max(1, round(live.settings.bridge / dt))
        lag = round(live.settings.lag / dt)
        before = lag + round(live.settings.reorder / dt)
        grid = TimeGrid(dt, bridge=bridge, before=before)
        memory: Checkpoint | None = None
        if checkpoint is not None:
            memory, others = checkpoint
            grid.origin, grid.newest = float(others["origin"]), int(others["newest"])
        estimation = LiveEstimation(
            prepared.recursion, live.model, lag=lag, engine=engine, memory=memory
        )
        keeper = None
        if store is not None:
            keeper = _keeper(live, store, prepared, grid, tell=tell)
        lanes = []
        for name, feed in live.feeds.items():
            source = source_of(name, feed, functools.partial(_replayed, live, feed))
            lanes.append(Lane(source, live, grid))
        if checkpoint is not None:
            shifts = json.loads(str(checkpoint[1]["clocks"]))
            for lane in lanes:
                lane.clock.shift = shifts.get(lane.name, lane.clock.shift)
            tell(f"goes on from {float(grid.time(estimation.base)):.6f} s")
        session = LiveSession(live, lanes, grid, estimation, keeper=keeper, tell=tell)
        for lane in lanes:
            lane.source.start()
            stack.callback(lane.source.stop)
            lane.channels  # noqa: B018 - what is missing is said before the first sample
        yield session


def compiled_live(live: LiveProblem, dt: float) -> Prepared:
    """The estimator as it runs: what is shown of it, and begun anew when it diverges."""
    needed = (*SHOWN, "S") if live.model.ny <= UNROLL else SHOWN
    return compile_once(
        live.estimator, live.model, dt, outputs=Outputs(("x_std",)), restart=True, needed=needed
    )


def _keeper(
    live: LiveProblem,
    store: LiveStore,
    prepared: Prepared,
    grid: TimeGrid,
    tell: Callable[[str], None],
) -> Keeper:
    labels = {c.name: c.labels for c in prepared.recursion.channels if c.labels}
    if live.model.virtual is not None:
        names = tuple(s.name for s in live.model.virtual.signals)
        labels |= {"z_hat": names, "z_std": names}

    def table(rows: LiveRows) -> dict[str, np.ndarray]:
        times = grid.time(np.arange(rows.start, rows.start + len(rows)))
        return columns_of(rows, live.model, times, labels)

    assert live.store is not None
    return Keeper(
        store, settings=live.store, table=table, units=column_units(live.model), tell=tell
    )


def _period(live: LiveProblem) -> float:
    if live.settings.dt is not None:
        return live.settings.dt
    for feed in live.feeds.values():
        if isinstance(feed, ReplayFeed):
            return float(_replayed(live, feed).attrs["dt"])
    raise ProblemError("live.dt: is missing; give the sampling period [s] of the estimator")


def _replayed(live: LiveProblem, feed: FeedTable) -> xr.Dataset:
    if not isinstance(feed, ReplayFeed) or feed.path is None:
        return recording_of(live.problem)
    table = RecordingTable(
        path=feed.path, inputs=feed.inputs, outputs=feed.outputs, time=feed.time, dt=feed.dt
    )
    return recording_of(dataclasses.replace(live.problem, recording=table))
