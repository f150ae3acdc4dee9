"""Begin a run: everything that can be wrong is said before the first sample."""

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from backsight.description import digest
from backsight.live._freezing import SEEN, Freezer
from backsight.live._lanes import Lane
from backsight.live._problem import LiveProblem
from backsight.live._ready import ReadyRun
from backsight.live._session import LiveSession
from backsight.live._sinks import Sinks
from backsight.live.alarms import Alarm, Alarms, Quantities, condition_of
from backsight.live.clock import TimeGrid
from backsight.live.engine import Checkpoint, LiveEstimation, LiveRows
from backsight.live.sources.base import ReceivingSource
from backsight.live.store import (
    Journal,
    Keeper,
    LiveStore,
    column_units,
    columns_of,
    joined_rows,
    journaled,
    opened_live_store,
)
from backsight.run.estimation import Prepared


@contextlib.contextmanager
def opened_session(ready: ReadyRun, *, tell: Callable[[str], None]) -> Iterator[LiveSession]:
    """Start a run: open the store, go on from its last part, start the sources.

    Raises
    ------
    ProblemError
        If something that is needed is missing.
    OutputError
        If the store cannot be used.
    """
    with contextlib.ExitStack() as stack:
        live, dt, varied, prepared = ready.live, ready.dt, ready.varied, ready.prepared
        for source in ready.sources:
            stack.callback(source.stop)
        labels = _labels(live, prepared)
        alarms = _alarms(live, labels, dt, tell)
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
        elif varied is not None:
            memory = _all_seen(prepared, live)
        estimation = LiveEstimation(
            prepared.recursion, live.model, lag=lag, engine=ready.engine, memory=memory
        )
        keeper = None
        if store is not None:
            keeper = _keeper(live, store, labels, grid, tell=tell)
        lanes = [Lane(source, live, grid) for source in ready.sources]
        if checkpoint is not None:
            shifts = json.loads(str(checkpoint[1]["clocks"]))
            for lane in lanes:
                lane.clock.shift = shifts.get(lane.name, lane.clock.shift)
                lane.go_on(checkpoint[1])
            tell(f"goes on from {float(grid.time(estimation.base)):.6f} s")
        session = LiveSession(live, lanes, grid, estimation, keeper=keeper, tell=tell)
        session.alarms, session.labels = alarms, labels
        if live.sinks:
            states = [s.name for s in live.model.states]
            quantities = Quantities(live.model, labels)
            session.sinks = Sinks(live.sinks, quantities, states=states, tell=tell)
            stack.callback(session.sinks.close)
        if varied is not None:
            window = max(1, round((live.settings.freeze or 0.0) / dt))
            session.freezer = Freezer(estimation, varied.walks, window=window, tell=tell)
        if keeper is not None and any(lane.source.durable for lane in lanes):
            _with_journal(session, keeper)
        for lane in lanes:
            lane.channels  # noqa: B018 - what is missing is said before the first sample
            lane.source.start()
        yield session


def _with_journal(session: LiveSession, keeper: Keeper) -> None:
    """Take in again what was acknowledged and did not become part of the store."""
    keeper.journal = Journal(keeper.store.folder)
    sources = {lane.name: lane.source for lane in session.lanes}
    for name, moment, payload in journaled(keeper.journal.left):
        if isinstance(source := sources.get(name), ReceivingSource):
            source.inbox.put_many([payload], moment=moment)
    session.round()


def _all_seen(prepared: Prepared, live: LiveProblem) -> Checkpoint:
    """Before the first sample no random walk is switched off."""
    fresh = Checkpoint.fresh(prepared.recursion, live.model)
    factors = [1.0 if s.name.startswith(SEEN) else np.nan for s in live.model.inputs]
    return dataclasses.replace(fresh, before=np.array(factors))


def _labels(live: LiveProblem, prepared: Prepared) -> dict[str, tuple[str, ...]]:
    """Names along dimensions of the estimator's own, by variable."""
    labels = {c.name: c.labels for c in prepared.recursion.channels if c.labels}
    if live.model.virtual is not None:
        names = tuple(s.name for s in live.model.virtual.signals)
        labels |= {"z_hat": names, "z_std": names}
    if "d_hat" in labels:
        labels.setdefault("d_std", labels["d_hat"])
    return labels


def _alarms(
    live: LiveProblem,
    labels: Mapping[str, Sequence[str]],
    dt: float,
    tell: Callable[[str], None],
) -> Alarms | None:
    if not live.alarms:
        return None
    quantities = Quantities(live.model, labels)
    alarms = {}
    for name, table in live.alarms.items():
        condition = condition_of(table, quantities, live.model, dt=dt, where=f"alarm.{name}")
        alarms[name] = Alarm(name, table, condition)
    return Alarms(alarms, tell=tell)


def _keeper(
    live: LiveProblem,
    store: LiveStore,
    labels: Mapping[str, Sequence[str]],
    grid: TimeGrid,
    *,
    tell: Callable[[str], None],
) -> Keeper:
    def table(parts: Sequence[LiveRows]) -> dict[str, np.ndarray]:
        slots = np.concatenate([np.arange(p.start, p.start + len(p)) for p in parts])
        return columns_of(joined_rows(parts), live.model, grid.time(slots), labels)

    assert live.store is not None
    return Keeper(
        store, settings=live.store, table=table, units=column_units(live.model), tell=tell
    )
