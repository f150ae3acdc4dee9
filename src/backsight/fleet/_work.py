"""What a worker does: read some recordings, run the estimators over them, tell a row of each.

A piece of work holds paths and settings, what comes back holds rows: no data is sent around.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import secrets
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import xarray as xr

from backsight.description import content
from backsight.engine.dense import UNROLL
from backsight.errors import BacksightError, DataError, WorkerError
from backsight.estimators.base import AbstractEstimator
from backsight.fleet._changes import Changes, changed, names_file
from backsight.fleet._numbers import Told, failed_row, row_of_result, row_of_totals
from backsight.fleet._recordings import Listed, Stamp
from backsight.models.model import Model
from backsight.output import put_in_place, writing
from backsight.problem.problem import Problem
from backsight.problem.reading.loading import problem_of, tree_of
from backsight.problem.recorded import paths_of, recording_of
from backsight.problem.results_file import write_estimates
from backsight.run.estimation import Outputs, estimate_many, match, smooth
from backsight.run.summaries import estimate_summaries

NEEDED = ("x_std", "e", "S", "y")
"""What a row is made of if it is made of a result."""

NO_MEMORY = "there is not enough memory"
"""A failure that says nothing of the data: it is tried again."""

DIGITS = 10
"""Of a sampling period: what is behind them is rounding of time stamps, and would make every
recording one with a period, and a program, of its own."""


@dataclasses.dataclass(frozen=True)
class Piece:
    """A recording of a piece of work.

    Parameters
    ----------
    item : str
        Name of the recording with the setting, see `item_of`.
    listed : Listed
    known : str
        Digest of the data of the row that is there; empty if there is none.
    """

    item: str
    listed: Listed
    known: str = ""


@dataclasses.dataclass(frozen=True)
class Work:
    """Some recordings with one setting.

    Parameters
    ----------
    version : str
        Of the package that asks for it.
    text, file : str
        Problem file as it was read, and where.
    setting : tuple of (key, value)
        What the sweep puts into it.
    pieces : tuple of Piece
    keep : Outputs, optional
        What is written of every result, into the folder `results`.
    results : str
    outside, env : tuple of str
        As of `backsight run`.
    """

    version: str
    text: str
    file: str
    setting: Changes
    pieces: tuple[Piece, ...]
    keep: Outputs | None
    results: str
    outside: tuple[str, ...] = ()
    env: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Landed:
    """What came out of a recording.

    Parameters
    ----------
    item : str
    digest : str
        Of the data; empty if they could not be read as a whole, so that it is tried again.
    stamp : tuple
        Of the files when they were read.
    rows : dict
        Estimator to row; empty if the digest is the one that is known.
    """

    item: str
    digest: str
    stamp: tuple[Stamp, ...]
    rows: Mapping[str, Told]


def done(work: Work) -> tuple[list[Landed], float]:
    """Do a piece of work.

    Returns
    -------
    list of Landed
        In order of the pieces.
    float
        Seconds for a recording, without what has to be made once.

    Raises
    ------
    WorkerError
        If this is another version of the package than the one that asks.
    OutputError
        If results cannot be written.
    """
    here = version_here()
    if here != work.version:
        raise WorkerError(
            f"a worker has version {here} of Backsight, the fleet was started with {work.version}; "
            "install the same one"
        )
    readings = [_read(piece, work) for piece in work.pieces]
    spent = sum(reading.seconds for reading in readings)
    groups: dict[object, list[_Reading]] = {}
    for reading in readings:
        if reading.data is not None:
            groups.setdefault(reading.group, []).append(reading)
    for members in groups.values():
        spent += _estimate(members, work)
    return [reading.landed() for reading in readings], spent / max(len(readings), 1)


def version_here() -> str:
    """Version of the package in this process."""
    return importlib.metadata.version("backsight")


@dataclasses.dataclass
class _Reading:
    """A recording on its way."""

    piece: Piece
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


def _read(piece: Piece, work: Work) -> _Reading:
    """Read a recording; what goes wrong is said in its row."""
    found = _Reading(piece)
    began = time.perf_counter()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found.failure = _reason(lambda: _read_into(found, piece, work))
    found.remarks = "; ".join(dict.fromkeys(" ".join(str(w.message).split()) for w in said))
    found.seconds = time.perf_counter() - began
    return found


def _reason(act: Callable[[], None]) -> str:
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


def _read_into(found: _Reading, piece: Piece, work: Work) -> None:
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


def _estimate(members: Sequence[_Reading], work: Work) -> float:
    """Run all estimators over recordings of one model and period; returns the seconds."""
    problem = members[0].problem
    assert problem is not None
    spent = 0.0
    for name, estimator in problem.estimators.items():
        began = time.perf_counter()
        smoothed = name in problem.smoothed
        rows, failure = _rows(members, estimator, problem.model, smoothed=smoothed)
        if failure and len(members) > 1:  # one of them is at fault; the others shall not suffer
            for one in members:
                rows, failure = _rows([one], estimator, problem.model, smoothed=smoothed)
                one.rows[name] = failed_row(failure) if failure else rows[0]
        else:
            for one, row in zip(members, rows or [failed_row(failure)], strict=True):
                one.rows[name] = row
        spent += time.perf_counter() - began
    if work.keep is not None:
        began = time.perf_counter()
        for one in members:
            one.failure = one.failure or _reason(functools.partial(_write, one, work))
        spent += time.perf_counter() - began
    return spent


def _rows(
    members: Sequence[_Reading], estimator: AbstractEstimator, model: Model, *, smoothed: bool
) -> tuple[list[Told], str]:
    """Rows of an estimator over recordings, or why there are none."""
    rows: list[Told] = []
    white = estimator.innovations == "white"
    data = [one.data for one in members if one.data is not None]

    def run() -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if smoothed:
                results = [smooth(estimator, model, d, throw=False) for d in data]
            elif model.ny > UNROLL:
                kept = Outputs(NEEDED)
                results = estimate_many(
                    estimator, model, data, outputs=kept, threads=1, throw=False
                )
            else:
                totals = estimate_summaries(estimator, model, data, threads=1)
                rows.extend(row_of_totals(totals, k, white=white) for k in range(len(data)))
                return
            rows.extend(
                row_of_result(r, dt=float(d.attrs["dt"]), white=white)
                for r, d in zip(results, data, strict=True)
            )

    return rows, _reason(run)


def _write(one: _Reading, work: Work) -> None:
    """Write what is kept of the results of a recording, whole or not at all."""
    problem, data, keep = one.problem, one.data, work.keep
    assert problem is not None
    assert data is not None
    results = {}
    for name, estimator in problem.estimators.items():
        if name in problem.smoothed:
            results[name] = smooth(estimator, problem.model, data, throw=False)
        else:
            results[name], *_ = estimate_many(
                estimator, problem.model, [data], outputs=keep, threads=1, throw=False
            )
    folder = Path(work.results)
    target = folder / f"{one.piece.item}.nc"
    part = folder / f".{target.name}.{secrets.token_hex(4)}.part"
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            write_estimates(
                part,
                results,
                title=f"{problem.title}: {one.piece.listed.name}",
                problem=said_with((*work.setting, *one.piece.listed.changes), problem.text),
                covariance=True,
            )
            put_in_place(part, target)
        finally:
            part.unlink(missing_ok=True)


def said_with(changes: Changes, text: str) -> str:
    """Text of a problem file with what stands there instead in comments above."""
    lines = [f"# with {key} = {value!r}\n" for key, value in changes]
    return "".join(lines) + text
