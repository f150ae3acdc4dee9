"""From the text of a problem file to a `Problem`."""

import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from backsight.discrete.runge_kutta import Integrator
from backsight.errors import ProblemError, nearest
from backsight.estimators import ALL_ESTIMATORS
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.problem.problem import Problem
from backsight.problem.reading._joint import check_known, joint_model
from backsight.problem.reading._places import check_units, put_places
from backsight.problem.reading._room import DEEPEST, MOST_BYTES, check_keys, check_tree
from backsight.problem.reading.checking import at, validated
from backsight.problem.reading.settings import built, fields_of
from backsight.problem.reading.tables import EstimatorTable, PartsTable, ProblemTable
from backsight.problem.reading.uncertain import noise, prior

_GROUP = re.compile(r"[\w+-]+(?:[ .][\w+-]+)*")
"""Names of estimators become names of groups in a file."""


def load(path: str | os.PathLike[str]) -> Problem:
    """Read a problem file and check everything in it that needs no recording.

    Parameters
    ----------
    path : path
        A TOML file, see `backsight.problem`.

    Raises
    ------
    ProblemError
        If the file cannot be read or is not TOML (with the line), or a key is missing, unknown or
        of the wrong kind, or its value does not fit the others (with the key).
    """
    file = Path(path)
    text = text_of(file)
    given = tree_of(text, file)
    if "recording" not in given and "source" in given:
        raise ProblemError(
            "recording: is missing; this file names sources: start it with `backsight live`"
        )
    return problem_of(given, text, file)


def tree_of(text: str, file: Path) -> dict[str, Any]:
    """The tables of a TOML file that is not beyond all measure; errors as of `load`."""
    check_keys(text)
    try:
        given = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProblemError(f"{file} is not TOML: {error}") from None
    except ValueError:  # of Python, which tells programmers what to do
        raise ProblemError(
            f"{file} is not TOML: a number has thousands of digits; whole numbers have 64 bits"
        ) from None
    except RecursionError:
        raise ProblemError(f"{file}: tables and lists are more than {DEEPEST} deep") from None
    check_tree(given)
    return given


def problem_of(given: dict[str, Any], text: str, file: Path) -> Problem:
    """Make a problem of the tables of its file; errors as of `load`.

    Parameters
    ----------
    given : dict
        From `tree_of`, as the file has it or with other values.
    text : str
        The file as it was read.
    file : Path
        Paths in the tables are relative to its folder.
    """
    listed = put_places(given, file.parent)
    table = validated(ProblemTable, given)
    built(Integrator, table.integrator, where="integrator", fixed={})
    model = joint_model(table, file.parent)
    check_units(listed, model)
    virtual = () if model.virtual is None else model.virtual.signals
    check_known(
        (*model.states, *virtual),
        table.recording.columns("truth"),
        kind="state",
        where="recording.truth",
    )
    states = [s.name for s in model.states]
    for name in table.reference:
        if name not in states:
            hint = nearest(name, states)
            raise ProblemError(f"reference.{name}: the model has no state '{name}', {hint}")
    if table.tune.estimator is not None and table.tune.estimator not in table.estimators:
        hint = nearest(table.tune.estimator, table.estimators)
        raise ProblemError(f"tune.estimator: there is no '{table.tune.estimator}', {hint}")
    estimators = {n: _estimator(n, e, table, model) for n, e in table.estimators.items()}
    for name, entry in table.estimators.items():
        _check_whole(f"estimators.{name}", entry, estimators[name], in_parts=table.recording.parts)
    return Problem(
        title=table.title or file.stem,
        path=file,
        text=text,
        recording=table.recording,
        model=model,
        estimators=estimators,
        smoothed=frozenset(name for name, e in table.estimators.items() if e.smooth),
        followed={n: e.follow for n, e in table.estimators.items() if e.follow is not None},
        searched={n: e.search for n, e in table.estimators.items() if e.search is not None},
        reference=table.reference,
        tune=table.tune,
        report=table.output.report,
        covariance=table.output.covariance,
    )


def text_of(file: Path) -> str:
    """Text of a TOML file; errors as of `load`."""
    try:
        kind = file.stat()
        if stat.S_ISDIR(kind.st_mode):
            raise ProblemError(f"'{file}' is a folder; give a file")
        if not stat.S_ISREG(kind.st_mode):
            raise ProblemError(f"'{file}' is a device or a pipe; give a file")
        if kind.st_size > MOST_BYTES:
            raise ProblemError(f"{file} has {kind.st_size} bytes; the limit is {MOST_BYTES}")
        return file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        others = [str(p.name) for p in file.parent.glob("*.toml")]
        hint = f", {nearest(file.name, others)}" if others else ""
        raise ProblemError(f"there is no file '{file}'{hint}") from None
    except OSError as error:
        raise ProblemError(f"cannot read '{file}': {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ProblemError(f"{file} is not text in UTF-8; save it as such") from None
    except ValueError as error:  # a zero in the name
        raise ProblemError(f"cannot read {str(file)!a}: {error}") from None


def _check_whole(
    where: str,
    entry: EstimatorTable,
    estimator: AbstractEstimator,
    *,
    in_parts: PartsTable | None,
) -> None:
    """Raise `ProblemError` if hits of a whole recording cannot be found with this estimator."""
    keys = [key for key in ("follow", "search") if getattr(entry, key) is not None]
    if not keys:
        return
    where = f"{where}.{keys[0]}"
    if not isinstance(estimator, AbstractForceEstimator):
        raise ProblemError(
            f"{where}: {estimator.title} looks for no unknown forces; take kind = 'csmhe'"
        )
    if len(keys) > 1 or entry.smooth:
        other = "search" if len(keys) > 1 else "smooth"
        raise ProblemError(f"{where}: goes without {other}; give one of them")
    if in_parts is not None:
        raise ProblemError(f"{where}: needs the whole recording; leave out recording.parts")
    for i, name in enumerate(entry.follow.beside if entry.follow else ()):
        if name not in estimator.forces:
            hint = nearest(name, estimator.forces)
            raise ProblemError(f"{where}.beside[{i}]: there is no force '{name}', {hint}")


def _estimator(
    name: str, entry: EstimatorTable, table: ProblemTable, model: Model
) -> AbstractEstimator:
    where = f"estimators.{name}"
    if not _GROUP.fullmatch(name):
        raise ProblemError(f"{where}: use letters, digits, blanks and . + - _ in the name")
    if entry.kind not in ALL_ESTIMATORS:
        hint = ALL_ESTIMATORS.hint(entry.kind)
        raise ProblemError(f"{where}.kind: unknown kind '{entry.kind}', {hint}")
    with at(f"{where}.kind"):
        kind = ALL_ESTIMATORS[entry.kind]
    takes_integrator = "integrator" in (f.name for f in fields_of(kind))
    common = {"integrator": table.integrator} if table.integrator and takes_integrator else {}
    gaps = table.recording.gaps
    unknowns = {**table.estimate, **table.disturbances, **gaps}
    sensors = {name: entry.sigma for name, entry in table.dummy.items() if entry.sigma is not None}
    sensors |= {name: entry.sigma_u for name, entry in gaps.items()}
    return built(
        kind,
        {**common, **entry.settings},
        where=where,
        fixed={
            "noise": noise(entry.noise, unknowns, model, sensors, where=f"{where}.noise")
            if entry.noise
            else noise(table.noise, unknowns, model, sensors, where="noise"),
            "prior": prior(entry.prior, unknowns, model, where=f"{where}.prior")
            if entry.prior
            else prior(table.prior, unknowns, model, where="prior"),
        },
    )
