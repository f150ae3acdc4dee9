"""Contenders that do the same work, timed in turns.

The machine may be shared. Every round runs all contenders one after the other, so that a change of
load meets all of them, and each is timed by wall clock and by processor time. The time of a round
is the smaller of the two: waiting for other processes does not count, and neither does the work of
several threads twice.
"""

import dataclasses
import importlib
import time
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from backsight.types import Array

LEAST_ROUNDS = 3
"""Rounds that every contender makes, unless it has taken `PATIENCE` before."""

PATIENCE = 20.0
"""Of the largest problems some need a minute for one round [s]."""


@dataclasses.dataclass(frozen=True)
class Contender:
    """Something that can be timed.

    Parameters
    ----------
    work : callable
        Does everything once and returns its estimates, (k, nx) scaled states.
    samples : int
        What the time is divided by: samples, windows, or samples of all recordings.
    expected : (n, nx) array, optional
        What the first estimates must be, computed by another route.
    """

    work: Callable[[], Array]
    samples: int
    expected: Array | None = None

    def difference(self) -> float:
        """Largest difference from the expected estimates, after doing the work once."""
        estimates = self.work()
        if self.expected is None:
            return np.nan
        n = min(len(estimates), len(self.expected))
        return float(np.abs(estimates[:n] - self.expected[:n]).max())


@dataclasses.dataclass(frozen=True)
class Entry:
    """A contender that is still to be built; building may fail, and the table then says so."""

    name: str
    build: Callable[[], Contender]


def peer(module: str, function: str, *arguments: object) -> Callable[[], Contender]:
    """A builder that imports the peer only when it is called."""

    def build() -> Contender:
        return getattr(importlib.import_module(f"benchmarks.peers.{module}"), function)(*arguments)

    return build


@dataclasses.dataclass(frozen=True)
class Row:
    """Times of one contender [us per sample], or why there are none.

    Parameters
    ----------
    contest, name : str
    best, median, wall : float
        Least and median time of a round, and the least by wall clock alone.
    difference : float
        Largest difference of a scaled state from the expected one.
    rounds : int
    failure : str
        Empty if all went well.
    """

    contest: str
    name: str
    best: float = np.nan
    median: float = np.nan
    wall: float = np.nan
    difference: float = np.nan
    rounds: int = 0
    failure: str = ""


@dataclasses.dataclass(frozen=True)
class Contest:
    """A table of times.

    Parameters
    ----------
    title : str
    unit : str
        What the times are per.
    entries : tuple of Entry
        The first one is what the others are compared with.
    remark : str
        What one must know to read it.
    """

    title: str
    unit: str
    entries: tuple[Entry, ...]
    remark: str = ""


def race(contest: Contest, *, rounds: int, seconds: float) -> list[Row]:
    """Build, check and time all contenders.

    Parameters
    ----------
    contest : Contest
    rounds : int
        Rounds at most.
    seconds : float
        A contender that has taken so long makes no further rounds, from `LEAST_ROUNDS` on.
    """
    ready: dict[str, Contender] = {}
    rows: dict[str, Row] = {}
    for entry in contest.entries:
        row = Row(contest.title, entry.name)
        try:
            ready[entry.name], difference = _ready(entry)
            rows[entry.name] = dataclasses.replace(row, difference=difference)
        except Exception as error:
            rows[entry.name] = dataclasses.replace(row, failure=reason(error))
    times = turns(list(ready.values()), rounds=rounds, seconds=seconds)
    for (name, contender), measured in zip(ready.items(), times, strict=True):
        spent, wall = 1e6 / contender.samples * measured
        rows[name] = dataclasses.replace(
            rows[name],
            best=float(spent.min()),
            median=float(np.median(spent)),
            wall=float(wall.min()),
            rounds=len(spent),
        )
    return list(rows.values())


def turns(contenders: Sequence[Contender], *, rounds: int, seconds: float) -> list[Array]:
    """Times of every contender, (2, rounds): what counts, and by wall clock [s]."""
    measured: list[list[tuple[float, float]]] = [[] for _ in contenders]
    for made in range(rounds):
        for contender, times in zip(contenders, measured, strict=True):
            spent = sum(wall for _, wall in times)
            if spent < (seconds if made >= LEAST_ROUNDS else PATIENCE):
                times.append(clock(contender.work))
    return [np.array(times).T for times in measured]


def clock(work: Callable[[], object]) -> tuple[float, float]:
    """Time without waiting for others, and by wall clock [s]."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    return min(wall, processor), wall


def reason(error: Exception) -> str:
    """Why a contender could not take part, in one line."""
    if isinstance(error, ModuleNotFoundError):
        return f"not installed: {error.name}"
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:150]}"


def _ready(entry: Entry) -> tuple[Contender, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of libraries that are not ours
        contender = entry.build()
        return contender, contender.difference()
