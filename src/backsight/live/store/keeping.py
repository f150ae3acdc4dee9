"""Hand results to the store in parts, without making the estimator wait for the disk."""

import concurrent.futures
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from backsight.errors import OutputError
from backsight.live.engine import Checkpoint, LiveRows
from backsight.live.sources import LiveSource
from backsight.live.store.journal import Journal
from backsight.live.store.writing import LiveStore
from backsight.models.model import Model
from backsight.problem.reading.tables import StoreTable
from backsight.types import Array

MOST_WAITING = 2_000_000
"""Samples that wait for room on the disk; the oldest are given up beyond that."""

_BY_SIGNAL = {
    "x_hat": "states",
    "x_std": "states",
    "y_hat": "outputs",
    "e": "outputs",
    "e_std": "outputs",
    "weight": "outputs",
}


def columns_of(
    rows: LiveRows, model: Model, times: Array, labels: Mapping[str, Sequence[str]]
) -> dict[str, np.ndarray]:
    """Columns of a table: ``time``, ``u.NAME``, ``y.NAME``, ``x_hat.NAME``, ... and ``status``."""
    found: dict[str, np.ndarray] = {"time": times}
    found |= {_input(s.name): rows.u[:, k] for k, s in enumerate(model.inputs)}
    found |= {f"y.{s.name}": rows.y[:, k] for k, s in enumerate(model.outputs) if s.dummy is None}
    for name, values in rows.values.items():
        if name in _BY_SIGNAL:
            names = [s.name for s in getattr(model, _BY_SIGNAL[name])]
        elif name in labels and values.ndim == 2:
            names = list(labels[name])
        elif values.ndim == 1:
            found[name] = values
            continue
        else:
            continue
        found |= {f"{name}.{n}": values[:, k] for k, n in enumerate(names)}
    return {n: np.ascontiguousarray(v) for n, v in found.items()}


def joined_rows(parts: Sequence[LiveRows]) -> LiveRows:
    """Rows one after the other; few operations on large arrays leave the interpreter to others."""
    first = parts[0]
    return LiveRows(
        first.start,
        np.concatenate([p.u for p in parts]),
        np.concatenate([p.y for p in parts]),
        {name: np.concatenate([p.values[name] for p in parts]) for name in first.values},
    )


def _input(name: str) -> str:
    """Column of an input; whether a parameter is seen is none of the user's inputs."""
    return name.replace("__", ".", 1) if name.startswith("seen__") else f"u.{name}"


def column_units(model: Model) -> dict[str, str]:
    """Unit of every column that has one."""
    found = {"time": "s"} | {_input(s.name): s.unit for s in model.inputs}
    for name, kind in (("y", "outputs"), *_BY_SIGNAL.items()):
        if name != "weight":
            found |= {f"{name}.{s.name}": s.unit for s in getattr(model, kind)}
    return found


_NICE = 10
"""By how much the thread that writes comes after those that receive and estimate."""


def _behind_others() -> None:
    """Let this thread have what others leave of the processor, where a thread can be told so."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)


class Keeper:
    """Rows that wait for the disk.

    Parameters
    ----------
    store : LiveStore
    settings : StoreTable
        How often a part is written, and what is removed.
    table : callable
        Makes columns of rows.
    units : dict
        Unit of every column.
    tell : callable
        Told what is wrong, and when it is right again.
    """

    def __init__(
        self,
        store: LiveStore,
        *,
        settings: StoreTable,
        table: Callable[[Sequence[LiveRows]], dict[str, np.ndarray]],
        units: Mapping[str, str],
        tell: Callable[[str], None],
    ) -> None:
        self.store, self._every, self._table, self._units = store, settings.every, table, units
        self._keep = settings.keep_days, settings.keep_mb
        self._tell = tell
        self._pool = concurrent.futures.ThreadPoolExecutor(1, "store", _behind_others)
        self._waiting: list[LiveRows] = []
        self._writing: concurrent.futures.Future[None] | None = None
        self._in_work: tuple[list[LiveRows], Callable[[], None]] | None = None
        self._due = time.monotonic() + self._every
        self.journal: Journal | None = None
        """For payloads that are acknowledged before they are in a part."""
        self._superfluous: list[Callable[[], None]] = []
        self.stored = self.given_up = 0
        """Samples on the disk, and such for which there was no room for too long, or at the end."""
        self.failure = ""
        """Why the last part could not be written."""

    def add(self, rows: LiveRows) -> None:
        """Take in samples that are settled."""
        if len(rows):
            self._waiting.append(rows)

    def tick(
        self,
        checkpoint: Callable[[], Callable[[], bytes]],
        stored: Callable[[], Callable[[], None]],
    ) -> None:
        """Begin to write a part if it is time.

        Parameters
        ----------
        checkpoint : callable
            Copies what must be kept to go on after the samples that were added; what it gives
            packs that.
        stored : callable
            Gives what is to be called when that is on the disk.
        """
        self._look()
        if self._writing is not None or time.monotonic() < self._due or not self._waiting:
            return
        self._due = time.monotonic() + self._every
        rows, self._waiting = self._waiting, []
        if self.journal is not None:
            self._superfluous.append(self.journal.turn())
        self._in_work = (rows, stored())
        self._writing = self._pool.submit(self._write, rows, checkpoint())

    def keep(self, source: LiveSource) -> None:
        """Write what a source has just brought to the journal; acknowledge it when it is safe."""
        if self.journal is None or not source.taken:
            return
        mark = source.mark()
        try:
            wait = self.journal.append(source.name, source.taken)
        except OutputError as error:  # it is sent again, or acknowledged with the part
            if not self.failure:
                self._tell(f"{error}; until there is room the broker keeps what comes")
            return
        self._pool.submit(lambda: (wait(), source.acknowledge(mark)))

    def close(
        self,
        checkpoint: Callable[[], Callable[[], bytes]],
        stored: Callable[[], Callable[[], None]],
    ) -> None:
        """Write what is left."""
        if self._writing is not None:
            concurrent.futures.wait([self._writing])
        self._due = 0.0
        self.tick(checkpoint, stored)
        self._pool.shutdown(wait=True)
        self._look()
        if lost := sum(map(len, self._waiting)):
            self.given_up += lost
            self._tell(f"{self.failure}: the last {lost} samples are not stored")
        if self.journal is not None:
            self.journal.close()

    def _look(self) -> None:
        """See whether a part has been written."""
        if self._writing is None or not self._writing.done() or self._in_work is None:
            return
        (rows, told), error = self._in_work, self._writing.exception()
        self._writing = self._in_work = None
        if error is None:
            self.stored += sum(map(len, rows))
            if self.failure:
                self._tell("the store can be written again")
                self.failure = ""
            told()
            for remove in self._superfluous:
                remove()
            self._superfluous = []
            return
        if not isinstance(error, OutputError):
            raise error
        if not self.failure:
            self._tell(f"{error}; results are kept in memory meanwhile")
        self.failure = str(error)
        self._waiting = rows + self._waiting
        while sum(map(len, self._waiting)) > MOST_WAITING:
            self.given_up += len(self._waiting.pop(0))

    def _write(self, rows: list[LiveRows], memory: Callable[[], bytes]) -> None:
        self.store.add(rows[0].start, self._table(rows), self._units, memory())
        days, size = self._keep
        self.store.thin_out(
            before=None if days is None else 86400.0 * days,
            largest=None if size is None else int(1e6 * size),
            now=time.time(),
        )


def checkpoint_bytes(
    checkpoint: Checkpoint,
    *,
    origin: float,
    newest: int,
    clocks: str,
    held: Mapping[str, Array],
) -> bytes:
    """What is kept with a part: the memory, the clock, and what delays hold back."""
    return checkpoint.packed(origin=origin, newest=float(newest), clocks=clocks, **held)
