"""List the columns of a file before it is read as a recording."""

import dataclasses
import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from backsight.data._request import Axis, Contents, Listed, Request, TextForm
from backsight.data.formats.loading import list_contents, read_contents
from backsight.data.listing._channel import ChannelLook, look
from backsight.data.listing._clock import Clock, clock_among, clock_of_dates
from backsight.data.listing._period import told_period
from backsight.data.listing.found import FileColumn, FileColumns
from backsight.data.times.clock import seconds
from backsight.description import Whole, checked
from backsight.errors import DataError
from backsight.types import Array


@checked(DataError, only=("decimal", "thousands", "header", "skip_lines"))
def list_columns(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,  # noqa: A002  the word of `read`
    axis: Axis | None = None,
    missing: Sequence[str | float] = (),
    delimiter: str | None = None,
    decimal: Literal[".", ","] | None = None,
    thousands: Literal[".", ",", "'", " "] | None = None,
    encoding: str | None = None,
    header: Whole | None = None,
    skip_lines: Whole = 0,
) -> FileColumns:
    r"""List the columns of a file: names, units, rates, ranges, and what looks wrong in them.

    Parameters
    ----------
    path : path
        Any file that `backsight.read` takes.
    format, axis, missing, delimiter, decimal, thousands, encoding, header, skip_lines : optional
        As in `backsight.read`.

    Returns
    -------
    FileColumns

    Raises
    ------
    DataError
        If the file cannot be read at all. A column that cannot be is listed with the reason.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "stage.csv")
    >>> _ = path.write_text("t [ms],u [V]\n0,1.5\n10,-1.5\n20,\n30,0.5\n")
    >>> found = list_columns(path)
    >>> found.clock, found.factor, found["u"].unit, found["u"].missing
    ('t', 0.001, 'V', 1)
    >>> folder.cleanup()
    """
    path = Path(path)
    text = TextForm(
        delimiter=delimiter,
        decimal=decimal,
        thousands=thousands,
        encoding=encoding,
        header=header,
        skip_lines=skip_lines,
        missing=tuple(missing),
    )
    request = Request((), axis=axis, text=text)
    listed = list_contents(path, request, format)
    numbers = [c.name for c in listed if c.kind == "numbers"]
    dates = [c.name for c in listed if c.kind == "dates"]
    dated = _joined(path, request, format, dates) or next(iter(dates), None)
    parts, faults = _read(path, request, format, numbers, dated)
    codes = [code for code in missing if not isinstance(code, str)]
    columns = {
        n: np.where(np.isin(v, codes), np.nan, v) if codes else np.asarray(v, float)
        for part in parts
        for n, v in part.columns.items()
        if n in numbers
    }
    units = {name: unit for part in parts for name, unit in part.units.items()}
    own = {n: p.time for p in parts if p.time is not None for n in p.columns if n in columns}
    clock, begin = _clock(parts, columns, units, dated, str(path))
    if clock is not None and clock.name in own:
        clock = dataclasses.replace(clock, sure=True)
    seen = {
        name: look(values, _period(name, own, clock))
        for name, values in columns.items()
        if clock is None or not (clock.sure and name == clock.name)
    }
    told = None
    if clock is None:
        told = told_period(listed, lambda name: _one_number(path, request, format, name))
    return FileColumns(
        path=path,
        columns={c.name: _column(c, columns, units, own, clock, seen, faults) for c in listed},
        clock=None if clock is None else clock.name,
        sure=clock is not None and clock.sure,
        factor=1.0 if clock is None else clock.factor,
        time_format="" if clock is None else clock.time_format,
        begin=begin,
        dt=clock.dt if clock is not None else told.dt if told is not None else np.nan,
        even=clock is not None and clock.even,
        codes=tuple(dict.fromkeys(c.code for c in seen.values() if c.code is not None)),
        understood="; ".join(dict.fromkeys(p.understood for p in parts if p.understood)),
        remarks=() if clock is None else clock.remarks,
        told=told,
    )


def _one_number(path: Path, request: Request, form: str | None, name: str) -> float | None:
    """The value of what is one number; None of anything else."""
    try:
        found = read_contents(path, dataclasses.replace(request, wanted=(name,)), form)
    except DataError:
        return None
    values = np.ravel(found.columns[name])
    return float(values[0]) if len(values) == 1 and values.dtype.kind in "fiu" else None


def _joined(path: Path, request: Request, form: str | None, dates: Sequence[str]) -> str | None:
    """A clock of two columns, date and time of the day, in either order; None if they are none."""
    for one, other in itertools.permutations(dates[:2], 2):
        both = f"{one} + {other}"
        asked = dataclasses.replace(request, wanted=(both,), clock=both)
        try:
            found = read_contents(path, asked, form)
            time, _ = seconds(found.columns[both], time_format=None, where=str(path))
        except (DataError, KeyError):
            continue
        if len(time) > 2 and np.median(np.diff(time)) > 0:
            return both
    return None


def _read(
    path: Path, request: Request, form: str | None, numbers: Sequence[str], dated: str | None
) -> tuple[list[Contents], dict[str, str]]:
    """All columns at once, or in parts where they do not go together; and what is wrong.

    Columns that go together stand together in most files, so that halves are tried first.
    """
    names = (*numbers, *([dated] if dated else []))
    if not names:
        return [], {}
    wanted = dataclasses.replace(request, wanted=names, clock=dated)
    try:
        return [read_contents(path, wanted, form)], {}
    except DataError as error:
        fault = str(error).removeprefix(f"{path}: ")
    if len(names) == 1:
        return [], {names[0]: fault}
    middle = len(numbers) // 2
    halves = [(numbers[:middle], None), (numbers[middle:], None)]
    if dated is not None:
        halves = [(numbers[:middle], dated), (numbers[middle:], dated)] if middle else halves
        halves += [] if middle else [((), dated)]
    parts, faults = zip(*(_read(path, request, form, *half) for half in halves), strict=True)
    return [p for part in parts for p in part], {k: v for own in faults for k, v in own.items()}


def _clock(
    parts: Sequence[Contents],
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    dated: str | None,
    where: str,
) -> tuple[Clock | None, str]:
    """The clock, and the date of its zero."""
    for part in parts:
        if dated is not None and dated in part.columns:
            time, begin = seconds(part.columns[dated], time_format=None, where=where)
            known = time[np.isfinite(time)]
            return (clock_of_dates(dated, known), begin) if len(known) > 2 else (None, begin)
    timed = [(p.time, p.begin) for p in parts if p.time is not None and len(p.time) > 2]
    if timed:
        fastest, begin = min(timed, key=lambda own: own[0][1] - own[0][0])
        own = [name for name, values in columns.items() if np.array_equal(values, fastest)]
        return clock_of_dates(own[0] if own else "", np.asarray(fastest)), begin
    return clock_among(columns, units), ""


def _period(name: str, own: Mapping[str, Array], clock: Clock | None) -> float | None:
    """Of the rows of a column [s], None if it is not known."""
    if name in own and len(own[name]) > 1:
        return float(np.mean(np.diff(own[name])))
    return None if clock is None or own or not clock.sure else clock.dt


def _column(
    listed: Listed,
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    own: Mapping[str, Array],
    clock: Clock | None,
    seen: Mapping[str, ChannelLook],
    faults: Mapping[str, str],
) -> FileColumn:
    name, unit = listed.name, units.get(listed.name, "")
    if name in faults:
        return FileColumn(name, "other", unit, remarks=(faults[name],))
    if name not in seen:
        remarks = (listed.remark,) if listed.remark else ()
        samples = len(columns[name]) if name in columns else 0
        ends = (columns[name][0], columns[name][-1]) if samples else (np.nan, np.nan)
        return FileColumn(
            name, listed.kind, unit, samples, low=ends[0], high=ends[1], remarks=remarks
        )
    channel, period = seen[name], _period(name, own, clock)
    return FileColumn(
        name,
        "numbers",
        unit,
        len(columns[name]),
        np.nan if not period else 1.0 / (period * channel.every),
        channel.low,
        channel.high,
        channel.missing,
        channel.noise,
        channel.walk,
        channel.remarks,
    )
