"""Read a recording from a file."""

import dataclasses
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from backsight.data import _checks as checks
from backsight.data._request import Axis, Request, TextForm
from backsight.data.columns import Column, ColumnLike, column, columns
from backsight.data.derived import columns_in, evaluated, remove_delays
from backsight.data.formats.loading import list_contents, read_contents
from backsight.data.recording import Group, as_recording, time_axis
from backsight.data.times.marks import times_of
from backsight.description import Whole, checked
from backsight.errors import DataError, nearest
from backsight.schema import SIGMA_FACTOR
from backsight.types import Array


@checked(DataError, only=("decimal", "thousands", "header", "skip_lines"))
def read(
    path: str | os.PathLike[str],
    *,
    inputs: Mapping[str, ColumnLike],
    outputs: Mapping[str, ColumnLike],
    time: ColumnLike | None = None,
    dt: float | None = None,
    truth: Mapping[str, ColumnLike] | None = None,
    start: float | None = None,
    stop: float | None = None,
    resample: float | None = None,
    grid: float | None = None,
    sigma_factor: Mapping[str, ColumnLike] | None = None,
    formulas: Mapping[str, str] | None = None,
    format: str | None = None,  # noqa: A002  the word of problem files
    axis: Axis | None = None,
    time_format: str | None = None,
    missing: Sequence[str | float] = (),
    delimiter: str | None = None,
    decimal: Literal[".", ","] | None = None,
    thousands: Literal[".", ",", "'", " "] | None = None,
    encoding: str | None = None,
    header: Whole | None = None,
    skip_lines: Whole = 0,
    outside: Collection[str] = (),
) -> xr.Dataset:
    r"""Read a recording and check it.

    Parameters
    ----------
    path : path
        Text (first line or last comment names the columns; also packed), MATLAB, HDF5, NetCDF,
        NumPy, LVM, WAV, OpenFAST, HAWC2, with ``pip install 'backsight[formats]'`` TDMS, MDF, UFF,
        Parquet, Feather, XLSX, MCAP, bags of ROS (a folder, too) and tables of MATLAB, and what an
        installed extension reads. What is in the file decides; the suffix is a hint.
    inputs, outputs : dict
        Name of the signal in the model to the column: its name, a `Column` with unit and factor,
        or a mapping with the fields of one. ``group/name`` reads from a structure or group, or a
        column of a table; ``acc[2]`` is the third channel of a matrix, ``/imu.rate.x`` a field of
        the messages on a topic. An empty cell or ``NaN`` in
        an output is "not measured". A unit that the file says is used where none is given.
    time : column, optional
        Time stamps [s], ``Column("t_ms", factor=1e-3)`` for milliseconds unless the file says
        that unit of the column (``t [ms]``); or dates, which count
        from the first sample (its date is the attribute ``begin``), or clock times.
    dt : float, optional
        Sampling period [s]; needed if there is no `time`, nor a time of the file's own (of
        recorders, simulators, robots, timetables).
    truth : dict, optional
        Reference values of states, as `outputs`; they become ``x_true (time, state)``.
    start, stop : float, optional
        Keep the samples with ``start <= t < stop`` [s].
    resample : float, optional
        Interpolate to this sampling period [s]; see `backsight.data.resample`.
    grid : float, optional
        Put samples with gaps or irregular times on an even grid of this period [s], nothing
        measured between them; see `backsight.data.to_grid`.
    sigma_factor : dict, optional
        Outputs whose samples have a noise of their own, as `outputs`: the column holds its standard
        deviation by the `sigma_y` of the estimator, or, with ``Column(name, factor=1 / sigma_y)``,
        the standard deviation itself. An empty cell is "not measured".
    formulas : dict, optional
        Further columns that are arithmetic on those of the file, ``{"a_rel": "roof - ground"}``,
        to be named as any other; see `backsight.from_equations` for what a formula may hold. A
        column whose name is no word is written with ``_``: ``Acc_roof`` for ``Acc roof``.
    format : str, optional
        How to read the file whatever it is called: "text", or a suffix as "mat".
    axis : 0 or 1, optional
        Axis of matrices along which time runs; if not given, the one that is as long as the other
        columns, or much longer than the other one.
    time_format : str, optional
        How dates are written, as in ``strptime``: "%m/%d/%Y %H:%M:%S.%f"; of stamps that are
        numbers "excel", "matlab" or "julian" (days), "unix", "unix_ms", "unix_us", "unix_ns",
        "ros", "dotnet" or "filetime".
    missing : sequence of str or float
        Values that stand for "not measured", as -999 or "ERR".
    delimiter, decimal, thousands, encoding, header, skip_lines : optional
        Of texts: what separates cells (" ": blanks), the signs in numbers, the encoding, the number
        of the line with the names (from 1 on; 0: there is none), and lines to pass over at the top.
        What is not given is taken from the file; the attribute ``understood`` of the recording says
        how.
    outside : collection of str
        Other files from which an HDF5, NetCDF or MAT file may take measurements (external storage,
        external links, virtual datasets), by the names that it has for them. The file must be
        trusted then: it could name any file of the computer.

    Returns
    -------
    xarray.Dataset
        ``u (time, input)`` and ``y (time, output)``, as `backsight.schema.recording` makes it.

    Raises
    ------
    DataError
        If the file or a column is missing or cannot be read, does not fit into memory, or takes
        measurements from other files or needs other programs to be read; the recording is empty,
        its time is not regular, an input is not known at every sample, an output is infinite, or a
        factor of the noise is not positive or belongs to no output; if a number, a date or an axis
        could be understood in two ways.
    PluginError
        If the reader of an extension is broken.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "stage.csv")
    >>> _ = path.write_text("t,u_V,y_um\n0.0,1.5,0.0\n0.1,-1.5,\n0.2,1.5,0.3\n")
    >>> drive = Column("u_V", unit="V")
    >>> recording = read(path, inputs={"V": drive}, outputs={"y": "y_um"}, time="t")
    >>> recording.y.to_numpy().ravel()
    array([0. , nan, 0.3])
    >>> folder.cleanup()
    """
    path = Path(path)
    if axis not in (None, 0, 1):
        raise DataError(f"{path}: axis is {axis!r}; give 0 (samples by channels) or 1")
    signals = [
        columns(inputs, "input"),
        columns(outputs, "output"),
        columns(truth or {}, "truth"),
        columns(sigma_factor or {}, SIGMA_FACTOR),
    ]
    for name in signals[3]:
        if name not in outputs:
            raise DataError(
                f"{SIGMA_FACTOR}: there is no output '{name}': {nearest(name, outputs)}"
            )
    clock = None if time is None else column(time, "time")
    if not signals[0] and not signals[1]:
        raise DataError(f"{path}: name at least one column as input or output")
    chosen = [c for group in signals for c in group.values()] + ([clock] if clock else [])
    request = Request(
        wanted=tuple(dict.fromkeys(c.name for c in chosen)),
        clock=clock.name if clock else None,
        time_format=time_format,
        axis=axis,
        outside=outside,
        text=TextForm(
            delimiter=delimiter,
            decimal=decimal,
            thousands=thousands,
            encoding=encoding,
            header=header,
            skip_lines=skip_lines,
            missing=tuple(missing),
        ),
    )
    made = {n: text for n, text in (formulas or {}).items() if n in request.wanted}
    meant: dict[str, str] = {}
    if made:
        listed = list_contents(path, dataclasses.replace(request, wanted=()), format)
        meant = columns_in(made, [c.name for c in listed if c.kind == "numbers"])
        own = [n for n in request.wanted if n not in made]
        wanted = tuple(dict.fromkeys([*own, *meant.values()]))
        request = dataclasses.replace(request, wanted=wanted)
    contents = read_contents(path, request, format)
    where = str(path)
    raw = {n: _measured(v, n, missing) for n, v in contents.columns.items() if n != request.clock}
    raw |= evaluated(made, meant, raw)
    given, begin, understood = contents.time, contents.begin, contents.understood
    if clock:
        own = contents.units.get(clock.name, "")
        marks = contents.columns[clock.name]
        given, begin, noted = times_of(clock, marks, own, time_format=time_format, where=where)
        raw[clock.name] = given
        understood = "; ".join(filter(None, (understood, noted)))
    lengths = {name: len(values) for name, values in raw.items()}
    if given is not None and not clock:
        lengths["the file's own time"] = len(given)
    n = checks.check_lengths(lengths, where)
    timed = slice(0, n) if given is None else _with_time(given, raw.values())
    if timed != slice(0, n):
        raw = {name: values[timed] for name, values in raw.items()}
        given = None if given is None else given[timed]
        note = f"{n - (timed.stop - timed.start)} rows without time and values left off"
        understood, n = "; ".join(filter(None, (understood, note))), timed.stop - timed.start
    stamps = time_axis(given, n, dt=dt, where=where)
    kept = _selected(stamps, start, stop, where)
    for name, c in ((n, c) for group in signals for n, c in group.items()):
        if c.contradicts(own := contents.units.get(c.name, "")):
            note = f"'{name}' is taken in {c.unit}, though the file says {own}"
            understood = "; ".join(filter(None, (understood, note)))
    u, y, x, factors = (_group(group, raw, contents.units, kept) for group in signals)
    recording = as_recording(
        stamps[kept],
        u=u,
        y=y,
        x=x if truth else None,
        sigma_factor=_spread(factors, y) if sigma_factor else None,
        dt=dt,
        resample=resample,
        grid=grid,
        first=timed.start + kept.start,
        begin=begin,
        understood=understood,
        where=where,
    )
    late = {n: c.delay for group in signals[:3] for n, c in group.items() if c.delay}
    return remove_delays(recording, late) if late else recording


def _measured(values: Array, name: str, missing: Sequence[str | float]) -> Array:
    """Numbers, with NaN for those that stand for "not measured"."""
    if values.dtype.kind not in "fiub":
        raise DataError(f"'{name}' holds dates; only time may be given by them")
    codes = [code for code in missing if not isinstance(code, str)]
    return np.where(np.isin(values, codes), np.nan, values) if codes else values


def _with_time(time: Array, columns: Iterable[Array]) -> slice:
    """All samples but those at both ends that have neither a time nor a value."""
    if np.isfinite(time[0]) and np.isfinite(time[-1]):
        return slice(0, len(time))
    there = np.isfinite(time)
    for values in columns:
        there |= ~np.isnan(values)
    known = np.flatnonzero(there)
    return slice(int(known[0]), int(known[-1]) + 1) if known.size else slice(0, len(time))


def _selected(time: Array, start: float | None, stop: float | None, where: str) -> slice:
    first = 0 if start is None else int(np.searchsorted(time, start))
    last = len(time) if stop is None else int(np.searchsorted(time, stop))
    if last - first < 2:
        raise DataError(
            f"{where}: fewer than 2 samples between start = {start} and stop = {stop} s; "
            f"the recording goes from {time[0]:.9g} to {time[-1]:.9g} s"
        )
    return slice(first, last)


def _spread(factors: Group, y: Group) -> Array:
    """Factors of all outputs: 1 where none is given."""
    given = dict(zip(factors.units, factors.values.T, strict=True))
    return np.stack([given.get(name, np.ones(len(y.values))) for name in y.units], axis=1)


def _side_by_side(columns: Sequence[Array], n: int) -> Array:
    """Columns of a matrix (n, k); a single one is not copied."""
    if len(columns) == 1:
        return columns[0][:, None]
    return np.stack(columns, axis=1) if columns else np.empty((n, 0))


def _group(
    signals: Mapping[str, Column], raw: Mapping[str, Array], units: Mapping[str, str], kept: slice
) -> Group:
    settled = {name: c.settled(units.get(c.name, "")) for name, c in signals.items()}
    values = [c.physical(raw[c.name][kept]) for c in settled.values()]
    n = kept.stop - kept.start
    return Group(
        _side_by_side(values, n),
        {name: c.unit_by(units.get(c.name, "")) for name, c in signals.items()},
    )
