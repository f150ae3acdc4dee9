"""From a problem file to what runs live."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from backsight.errors import ProblemError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.problem.problem import Problem
from backsight.problem.reading.checking import validated
from backsight.problem.reading.loading import problem_of, text_of, tree_of
from backsight.problem.reading.tables import (
    ALARMS,
    FEEDS,
    SINKS,
    AlarmTable,
    ColumnTable,
    DashboardTable,
    FeedTable,
    LiveTable,
    ReplayFeed,
    SinkTable,
    StoreTable,
    StrictTable,
)
from backsight.schema import SAME
from backsight.types import Array
from backsight.units import conversion, convertible

T = TypeVar("T", bound=StrictTable)

RECORDING = "recording"
"""Name of the source that replays the recording of the file, where none is given."""


@dataclasses.dataclass(frozen=True)
class LiveProblem:
    """A problem whose samples come while it runs.

    Parameters
    ----------
    problem : Problem
    settings : LiveTable
    feeds : dict
        Sources by name.
    store : StoreTable, optional
    alarms : dict
        By name.
    parameters : tuple of str
        Parameters that are estimated.
    dashboard : DashboardTable, optional
    sinks : dict
        By name.
    """

    problem: Problem
    settings: LiveTable
    feeds: Mapping[str, FeedTable]
    store: StoreTable | None
    alarms: Mapping[str, AlarmTable]
    parameters: tuple[str, ...]
    dashboard: DashboardTable | None
    sinks: Mapping[str, SinkTable]

    @property
    def model(self) -> Model:
        """The model, with what is unknown among its states."""
        return self.problem.model

    @property
    def estimator_name(self) -> str:
        """Name of the estimator that runs."""
        return self.settings.estimator or next(iter(self.problem.estimators))

    @property
    def estimator(self) -> AbstractEstimator:
        """The estimator that runs."""
        return self.problem.estimators[self.estimator_name]


def load_live(path: Path, *, speed: float | None = None) -> LiveProblem:
    """Read a problem file for samples that come while it runs.

    Without a source, the recording of the file is replayed.

    Parameters
    ----------
    path : Path
    speed : float, optional
        Of a replay, in place of the file's.

    Raises
    ------
    ProblemError
        As of `backsight.problem.load`, and if sources do not bring what the model needs.
    """
    text = text_of(path)
    given = tree_of(text, path)
    feeds = _feeds(given, speed)
    replayed = [n for n, f in feeds.items() if isinstance(f, ReplayFeed) and not f.path]
    if replayed and len(feeds) > 1:
        raise ProblemError(
            f"source.{replayed[0]}: the recording of the file has all signals; leave the other "
            "sources out, or give a path"
        )
    whole = given if replayed else {**given, "recording": _as_recording(given["source"], feeds)}
    try:
        problem = problem_of(whole, text, path)
    except ProblemError as error:
        message = str(error)
        if not replayed and message.startswith("recording."):
            owner = f"source.{next(iter(feeds))}" if len(feeds) == 1 else "source"
            message = owner + message.removeprefix("recording")
        raise ProblemError(message) from None
    settings = validated(LiveTable, given.get("live", {}), where="live")
    known = problem.estimators
    if settings.estimator is not None and settings.estimator not in known:
        hint = nearest(settings.estimator, known)
        raise ProblemError(f"live.estimator: there is no '{settings.estimator}', {hint}")
    problem.check_by_sample([settings.estimator or next(iter(known))], "backsight live")
    store, shown = given.get("store"), given.get("dashboard")
    return LiveProblem(
        problem=problem,
        settings=settings,
        feeds=feeds,
        store=None if store is None else validated(StoreTable, store, where="store"),
        alarms=_by_kind(given, "alarm", ALARMS),
        parameters=tuple(given.get("estimate", {})),
        dashboard=None if shown is None else validated(DashboardTable, shown, where="dashboard"),
        sinks=_by_kind(given, "sink", SINKS),
    )


def _feeds(given: Mapping[str, Any], speed: float | None) -> dict[str, FeedTable]:
    if not given.get("source"):
        if "recording" not in given:
            raise ProblemError(
                "source: is missing; say where samples come from, [source.NAME], or name a "
                "[recording] to replay"
            )
        given = {"source": {RECORDING: {"kind": "replay"}}}
    feeds = _by_kind(given, "source", FEEDS)
    if speed is None:
        return feeds
    return {
        name: feed.model_copy(update={"speed": speed}) if isinstance(feed, ReplayFeed) else feed
        for name, feed in feeds.items()
    }


def _by_kind(given: Mapping[str, Any], key: str, kinds: Mapping[str, type[T]]) -> dict[str, T]:
    """Tables with names of their own, each of a kind."""
    entries = given.get(key, {})
    tables = entries.values() if isinstance(entries, Mapping) else [None]
    if any(not isinstance(table, Mapping) for table in tables):
        raise ProblemError(f"{key}: give every one a name, [{key}.NAME], with its kind")
    found = {}
    for name, entry in entries.items():
        kind = str(entry.get("kind"))
        if kind not in kinds:
            what = f"unknown kind '{kind}'" if "kind" in entry else "is missing"
            raise ProblemError(f"{key}.{name}.kind: {what}, {nearest(kind, kinds)}")
        found[name] = validated(kinds[kind], dict(entry), where=f"{key}.{name}")
    return found


def _as_recording(
    sources: Mapping[str, Mapping[str, Any]], feeds: Mapping[str, FeedTable]
) -> dict[str, Any]:
    """The tables of sources as that of a recording, from which the model knows its signals."""
    seen: dict[str, str] = {}
    joined: dict[str, Any] = {"path": "live", "inputs": {}, "outputs": {}}
    for name, feed in feeds.items():
        if not feed.columns_wanted:
            raise ProblemError(f"source.{name}: names no column as input or output")
        for kind in ("inputs", "outputs"):
            for signal, entry in sources[name].get(kind, {}).items():
                if (before := seen.setdefault(f"{kind}.{signal}", name)) != name:
                    raise ProblemError(
                        f"source.{name}.{kind}.{signal}: comes from source.{before}, too"
                    )
                joined[kind][signal] = entry
    if not joined["outputs"]:
        raise ProblemError("source: no source has an output; name at least one sensor")
    return joined


@dataclasses.dataclass(frozen=True)
class Channels:
    """Which numbers of a source are which signals, and how they become physical.

    Parameters
    ----------
    places : tuple of int
        Columns among the inputs and outputs of the model.
    columns : tuple of int
        Columns of the source's samples.
    factors, offsets : (m,) arrays
    delays : (m,) array
        Samples by which they are late, whole or not.
    """

    places: tuple[int, ...]
    columns: tuple[int, ...]
    factors: Array
    offsets: Array
    delays: Array

    def physical(self, values: Array) -> Array:
        """Signals (n, m) of samples (n, l)."""
        return values[:, self.columns] * self.factors + self.offsets


def channels_of(
    name: str, feed: FeedTable, live: LiveProblem, dt: float, *, columns: list[str]
) -> Channels:
    """Return the signals of a source among its columns.

    Raises
    ------
    ProblemError
        If samples would always come too late, or a mean shall be subtracted.
    """
    model = live.model
    signals = [*(s.name for s in model.inputs), *(s.name for s in model.outputs)]
    units = [*(s.unit for s in model.inputs), *(s.unit for s in model.outputs)]
    nu = model.nu
    places, found, factors, offsets, delays = [], [], [], [], []
    for kind, table in (("inputs", feed.inputs), ("outputs", feed.outputs)):
        for signal, column in table.items():
            where = f"source.{name}.{kind}.{signal}"
            place = signals.index(signal, 0 if kind == "inputs" else nu)
            factor, offset = _to_model(column, units[place])
            places.append(place)
            found.append(columns.index(column.column))
            factors.append(factor)
            offsets.append(offset)
            delays.append(_delay(column, live.settings, dt, where))
    return Channels(
        tuple(places), tuple(found), np.array(factors), np.array(offsets), np.array(delays)
    )


def _to_model(column: ColumnTable, unit: str) -> tuple[float, float]:
    """Factor and offset from the number that comes to the unit of the model."""
    factor, offset = 1.0 if column.factor is None else column.factor, column.offset
    if column.unit and unit and column.unit != unit and convertible(column.unit, unit):
        between = conversion(column.unit, unit)
        return between.factor * factor, between.factor * offset + between.offset
    return factor, offset


def _delay(column: ColumnTable, settings: LiveTable, dt: float, where: str) -> float:
    """Samples by which a column is late."""
    if column.remove_mean:
        raise ProblemError(f"{where}.remove_mean: the mean is not known while samples come")
    if column.delay > settings.lag + settings.reorder:
        raise ProblemError(
            f"{where}.delay: is longer than samples may be late; give live.lag at least "
            f"{column.delay:g} s"
        )
    count = column.delay / dt
    return round(count) if abs(count - round(count)) <= SAME else count
