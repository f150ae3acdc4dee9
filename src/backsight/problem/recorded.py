"""The recording of a problem."""

import os
import re
from collections.abc import Collection
from pathlib import Path

import xarray as xr

from backsight.data.columns import Column
from backsight.data.derived import convert_units
from backsight.data.merging import merge
from backsight.data.parts import RecordingParts, read_parts
from backsight.data.reader import read
from backsight.errors import ProblemError
from backsight.models.model import Model
from backsight.problem.problem import Problem
from backsight.problem.reading.tables import ColumnTable, FileTable, SourceTable
from backsight.signals import high_pass

_VARIABLE = re.compile(r"\$\{(\w+)\}")

DATA = "BACKSIGHT_DATA"
"""The environment variable that every problem file may use: it holds nothing but a folder."""

IN_PARTS = {"path", "source", "inputs", "outputs", "time", "dt", "format", "parts"}
"""Keys of ``[recording]`` that a recording in parts knows."""


def recording_of(
    problem: Problem, *, outside: Collection[str] = (), env: Collection[str] = ()
) -> xr.Dataset:
    """Read the recording of a problem, as `backsight.data.read` does.

    Several files are brought together by their times, each on its own clock, less its `delay`, as
    `backsight.data.merge` does. Signals are converted to the units of the model. The path is
    relative to the problem file; ``${NAME}`` in it stands for the environment variable. From
    which other files it may take measurements (`outside`), and which variables beside
    ``BACKSIGHT_DATA`` it may use (`env`), a problem file cannot say: it may come from elsewhere
    with the recording, and must not find out what the environment holds.

    Raises
    ------
    ProblemError
        If an environment variable is not allowed or not set, or there is no file and the problem
        says where to get it.
    DataError
        If the recording cannot be read or is not regular.
    """
    parts = [
        _read(problem.recording.files[where], path, where, outside)
        for where, path in paths_of(problem, env=env).items()
    ]
    recording = merge(*parts) if len(parts) > 1 else parts[0]
    cutoff = problem.recording.high_pass
    found = convert_units(recording, _units(problem.model))
    return found if cutoff is None else high_pass(found, cutoff)


def parts_of(problem: Problem, *, env: Collection[str] = ()) -> RecordingParts:
    """The recording of a problem in parts, as `backsight.large.read_parts` opens it.

    Raises
    ------
    ProblemError
        If a key asks for what needs the whole recording, or for an environment variable that is
        not allowed.
    DataError
        As of `backsight.large.read_parts`.
    """
    table = problem.recording
    assert table.parts is not None
    asked = table.model_dump(exclude_unset=True)
    for key in asked.keys() - IN_PARTS:
        raise ProblemError(
            f"recording.{key}: needs the whole recording, or is not known for one in parts; leave "
            "it out, or leave out recording.parts"
        )
    for name, entry in {**table.inputs, **table.outputs}.items():
        if entry.delay or entry.remove_mean or name in table.with_gaps:
            raise ProblemError(
                f"recording: '{name}' has a delay, gaps or a mean to be removed, which needs the "
                "whole recording; leave it out, or leave out recording.parts"
            )
    model = problem.model
    return read_parts(
        problem.path.parent / expanded(table.path, "recording.path", env=env),
        inputs={name: _column(entry) for name, entry in table.inputs.items()},
        outputs={name: _column(entry) for name, entry in table.outputs.items()},
        time=None if table.time is None else _column(table.time),
        dt=table.dt,
        samples=table.parts.samples,
        format=table.format,
        units=_units(model),
    )


def _units(model: Model) -> dict[str, str]:
    """Units that signals of a recording have in the model."""
    virtual = () if model.virtual is None else model.virtual.signals
    signals = (*model.inputs, *model.outputs, *model.states, *virtual)
    return {s.name: s.unit for s in signals if s.unit}


def paths_of(problem: Problem, *, env: Collection[str] = ()) -> dict[str, Path]:
    """Path of every file of the recording by the key of its table; see `recording_of`."""
    return {
        where: _path(table, where, problem.path.parent, env)
        for where, table in problem.recording.files.items()
    }


def _read(table: FileTable, path: Path, where: str, outside: Collection[str]) -> xr.Dataset:
    if table.source and not path.exists():
        raise ProblemError(
            f"{where}.path: there is no file '{path}'; where to get it: {table.source}"
        )
    recording = read(
        path,
        inputs={n: _column(entry) for n, entry in table.inputs.items() if not entry.gaps},
        outputs={
            n: _column(entry)
            for n, entry in (*table.outputs.items(), *table.inputs.items())
            if n in table.outputs or n in table.with_gaps
        },
        truth={name: _column(entry) for name, entry in table.truth.items()},
        sigma_factor={name: _column(entry) for name, entry in table.sigma_factor.items()},
        formulas=table.formulas,
        time=None if table.time is None else _column(table.time),
        dt=table.dt,
        start=table.start,
        stop=table.stop,
        resample=table.resample,
        grid=table.grid,
        format=table.format,
        axis=table.axis,
        time_format=table.time_format,
        missing=table.missing,
        delimiter=table.delimiter,
        decimal=table.decimal,
        thousands=table.thousands,
        encoding=table.encoding,
        header=table.header,
        skip_lines=table.skip_lines,
        outside=outside,
    )
    if isinstance(table, SourceTable) and table.delay:
        recording = recording.assign_coords(time=recording.time - table.delay)
    return recording


def _path(table: FileTable, where: str, folder: Path, env: Collection[str]) -> Path:
    return folder / expanded(table.path, f"{where}.path", env=env, source=table.source)


def expanded(text: str, where: str, *, env: Collection[str], source: str = "") -> str:
    """A path with the values of the environment variables in it.

    Parameters
    ----------
    text : str
        The path as a file has it.
    where : str
        Key of the path, for messages.
    env : collection of str
        Variables that may be used beside ``BACKSIGHT_DATA``.
    source : str
        Where to get the data.

    Raises
    ------
    ProblemError
        If a variable is not allowed or not set.
    """
    for name in _VARIABLE.findall(text):
        # Before anything else is said of it: a refusal must not tell whether it is set.
        if name not in (DATA, *env):
            raise ProblemError(
                f"{where}: the file asks for the environment variable {name}; allow it with "
                f"--env {name} if you trust the file, or write the folder"
            )
        if not os.environ.get(name):
            hint = f"; where to get it: {source}" if source else ""
            raise ProblemError(
                f"{where}: the environment variable {name} is not set; set it to the folder "
                f"of the data{hint}"
            )
    return _VARIABLE.sub(lambda match: os.environ[match[1]], text)


def _column(entry: ColumnTable) -> Column:
    return Column(
        entry.column,
        unit=entry.unit,
        factor=entry.factor,
        offset=entry.offset,
        delay=entry.delay,
        remove_mean=entry.remove_mean,
    )
