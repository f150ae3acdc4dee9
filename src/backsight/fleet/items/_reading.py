"""Read a recording of a fleet with its setting; what goes wrong is said in its row."""

import dataclasses
import functools
import hashlib
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import xarray as xr

from backsight.description import content
from backsight.errors import BacksightError, DataError, WorkerError
from backsight.fleet._changes import Changes, changed, names_file
from backsight.fleet._recordings import Stamp
from backsight.fleet.items.work import Item, Work
from backsight.fleet.rows import Landed
from backsight.fleet.rows.numbers import Told, failed_row
from backsight.problem.problem import Problem
from backsight.problem.reading.loading import problem_of, tree_of
from backsight.problem.recorded import paths_of, recording_of
from backsight.run.estimation import match

NO_MEMORY = "there is not enough memory"
"""A failure that says nothing of the data: it is tried again."""

DIGITS = 10
"""Of a sampling period: what is behind them is rounding of time stamps, and would make every
recording one with a period, and a program, of its own."""


@dataclasses.dataclass
class Reading:
    """A recording on its way."""

    piece: Item
    problem: Problem | None = None
    data: xr.Dataset | None = None
    digest: str = ""
    stamp: tuple[Stamp, ...] = ()
    group: object = None
    remarks: str = ""
    seconds: float = 0.0
    failure: str = ""
    rows: dict[str, Told] = dataclasses.field(default_factory=dict)

    def landed(self) -> Landed:
        rows = self.rows
        if self.failure:
            names = self.problem.estimators if self.problem else ("",)
            rows = {name: failed_row(self.failure) for name in names}
        said = {"remarks": self.remarks} if self.remarks else {}
        told = {name: {**row, **said} for name, row in rows.items()}
        again = any(row["failure"] == NO_MEMORY for row in rows.values())
        return Landed(self.piece.item, "" if again else self.digest, self.stamp, told)


def read_item(piece: Item, work: Work) -> Reading:
    """Read a recording; what goes wrong is said in its row."""
    found = Reading(piece)
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found.failure = reason_of(lambda: _read_into(found, piece, work))
    found.remarks = "; ".join(dict.fromkeys(" ".join(str(w.message).split()) for w in said))
    found.seconds = time.perf_counter() - began
    return found


def reason_of(act: Callable[[], None]) -> str:
    """Why something went wrong; empty if it did not."""
    try:
        act()
    except WorkerError:
        raise
    except BacksightError as error:
        return str(error)
    except MemoryError:
        return NO_MEMORY
    except Exception as error:  # of a library, at a file that nobody has foreseen
        return f"unexpected {type(error).__name__}: {error}"
    return ""


def _read_into(found: Reading, piece: Item, work: Work) -> None:
    changes = (*work.setting, *piece.listed.changes)
    found.problem = problem = problem_with(work.text, work.file, changes, piece.listed.path)
    _, group = _problem(work.text, work.file, _own(changes))
    before = piece.listed.stamp()
    found.stamp = before
    found.digest = _digest([*paths_of(problem, env=work.env).values()])
    if found.digest == piece.known:
        return
    data = recording_of(problem, outside=work.outside, env=work.env)
    if piece.listed.stamp() != before:
        found.digest = ""
        raise DataError(f"{piece.listed.name} changes while it is read; wait until it is whole")
    dt = float(f"{float(data.attrs['dt']):.{DIGITS}g}")
    found.data, found.group = data.assign_attrs(dt=dt), (group, dt)
    for estimator in problem.estimators.values():
        match(problem.model, data, estimator=estimator)


def _digest(paths: Sequence[Path]) -> str:
    made = hashlib.blake2b(digest_size=20)
    for path in paths:
        try:
            with path.open("rb") as file:
                while part := file.read(1 << 20):
                    made.update(part)
        except OSError as error:
            raise DataError(f"{path} cannot be read: {error.strerror or error}") from None
        made.update(b"|")
    return made.hexdigest()


@dataclasses.dataclass(frozen=True)
class _Once:
    """Changes as a key, whatever their values are."""

    changes: Changes

    def __hash__(self) -> int:
        return hash(repr(self.changes))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Once) and repr(other.changes) == repr(self.changes)


def problem_with(text: str, file: str, changes: Changes, path: str) -> Problem:
    """A problem with other values and another recording.

    Parameters
    ----------
    text, file : str
        Problem file as it was read, and where.
    changes : tuple of (key, value)
    path : str
        The recording.
    """
    problem, _ = _problem(text, file, _own(changes))
    return _with_files(problem, dict(changes), path)


def _own(changes: Changes) -> _Once:
    """What is not only another file: those are read alike."""
    return _Once(tuple(change for change in changes if not names_file(change[0])))


@functools.lru_cache(maxsize=64)
def _problem(text: str, file: str, once: _Once) -> tuple[Problem, object]:
    """The problem with these values, and a key that is the same if the estimators are."""
    path = Path(file)
    problem = problem_of(changed(tree_of(text, path), once.changes), text, path)
    key = content(problem.model, dict(problem.estimators))
    return problem, once if key is None else key


def _with_files(problem: Problem, changes: Mapping[str, object], path: str) -> Problem:
    """The problem with other files, whose paths are known from the fleet file on."""
    table = problem.recording
    sources = {
        name: source.model_copy(update={"path": changes[key]})
        if (key := f"recording.sources.{name}.path") in changes
        else source
        for name, source in table.sources.items()
    }
    moved = table.model_copy(update={"path": path, "sources": sources})
    return dataclasses.replace(problem, recording=moved)


def said_with(changes: Changes, text: str) -> str:
    """Text of a problem file with what stands there instead in comments above."""
    lines = [f"# with {key} = {value!r}\n" for key, value in changes]
    return "".join(lines) + text
