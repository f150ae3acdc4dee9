"""The recording of a problem."""

import os
import re
from collections.abc import Collection
from pathlib import Path

import xarray as xr

from backsight.data.columns import Column
from backsight.data.reader import read
from backsight.errors import ProblemError
from backsight.problem.problem import Problem
from backsight.problem.reading.tables import ColumnTable
from backsight.signals import high_pass

_VARIABLE = re.compile(r"\$\{(\w+)\}")


def recording_of(problem: Problem, *, outside: Collection[str] = ()) -> xr.Dataset:
    """Read the recording of a problem, as `backsight.data.read` does.

    The path is relative to the problem file; ``${NAME}`` in it stands for the environment variable.
    From which other files it may take measurements (`outside`), a problem file cannot say: it may
    come from elsewhere with the recording.

    Raises
    ------
    ProblemError
        If an environment variable is not set, or there is no file and the problem says where to get
        it.
    DataError
        If the recording cannot be read or is not regular.
    """
    table = problem.recording
    path = _path(problem)
    if table.source and not path.exists():
        raise ProblemError(
            f"recording.path: there is no file '{path}'; where to get it: {table.source}"
        )
    data = read(
        path,
        inputs={n: _column(entry) for n, entry in table.inputs.items() if not entry.gaps},
        outputs={
            n: _column(entry)
            for n, entry in (*table.outputs.items(), *table.inputs.items())
            if n in table.outputs or n in table.with_gaps
        },
        truth={name: _column(entry) for name, entry in table.truth.items()},
        sigma_factor={name: _column(entry) for name, entry in table.sigma_factor.items()},
        time=None if table.time is None else _column(table.time),
        dt=table.dt,
        start=table.start,
        stop=table.stop,
        resample=table.resample,
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
    return data if table.high_pass is None else high_pass(data, table.high_pass)


def _path(problem: Problem) -> Path:
    text, source = problem.recording.path, problem.recording.source
    for name in _VARIABLE.findall(text):
        if not os.environ.get(name):
            hint = f"; where to get it: {source}" if source else ""
            raise ProblemError(
                f"recording.path: the environment variable {name} is not set; set it to the folder "
                f"of the data{hint}"
            )
    expanded = _VARIABLE.sub(lambda match: os.environ[match[1]], text)
    return problem.path.parent / expanded


def _column(entry: ColumnTable) -> Column:
    return Column(
        entry.column,
        unit=entry.unit,
        factor=entry.factor,
        offset=entry.offset,
        remove_mean=entry.remove_mean,
    )
