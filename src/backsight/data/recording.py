"""From arrays to a checked recording."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from backsight import schema
from backsight.data import _checks as checks
from backsight.data._named import (
    in_seconds,
    index_of,
    is_named,
    is_quantity,
    named_columns,
    unit_of,
)
from backsight.data.resampling import resample as resampled
from backsight.data.resampling import to_grid
from backsight.data.times.clock import epoch_form, seconds
from backsight.errors import DataError
from backsight.types import Array
from backsight.units import conversion, convertible

BEGIN = "begin"
"""Attribute of a recording with the date of the zero of its time (UTC if the zone is known)."""

UNDERSTOOD = "understood"
"""Attribute of a recording: how its file was understood where it could be seen otherwise."""


@dataclasses.dataclass(frozen=True)
class Group:
    """The inputs, the outputs or the reference states of a recording.

    Parameters
    ----------
    values : (n, k) array
        Time first.
    units : dict
        Name to unit of every column.
    """

    values: Array
    units: Mapping[str, str]


def from_arrays(
    *,
    u: Any = None,
    y: Any,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    time: Any = None,
    dt: float | None = None,
    resample: float | None = None,
    grid: float | None = None,
    sigma_factor: Any = None,
) -> xr.Dataset:
    """Make a recording of arrays.

    Parameters
    ----------
    u, y : (n, nu) and (n, ny) arrays, or (n,) for a single signal
        Inputs and outputs; ``NaN`` in `y` is "not measured". Without inputs, leave out `u`. What
        has names goes in by name, whatever its order: a data frame (pandas, polars), a dataset or
        a labelled array of xarray, a dictionary, a structured array. What has units (of xarray, of
        pint) is converted to those that are named here.
    inputs, outputs : dict
        Name to unit of every column, in order of the columns unless these have names.
    time : (n,) array, optional
        Time of every sample [s]; or dates (``datetime64``, `pandas.DatetimeIndex`, Python's, text),
        which count from the first one, or intervals (``timedelta64``); or the name of the column of
        `y` with them. If not given, a data frame's own index of dates or intervals.
    dt : float, optional
        Sampling period [s]; needed if there is no `time`.
    resample : float, optional
        Interpolate to this sampling period [s]; see `backsight.data.resample`.
    grid : float, optional
        Put samples with gaps or irregular times on an even grid of this period [s], nothing
        measured between them; see `backsight.data.to_grid`.
    sigma_factor : array as y, optional
        Where the noise of a sample is not the nominal one: its standard deviation by the `sigma_y`
        of the estimator, above 0. With correlated noise the correlation stays. ``NaN`` and infinity
        are "not measured".

    Returns
    -------
    xarray.Dataset
        ``u (time, input)`` and ``y (time, output)``, as `backsight.schema.recording` makes it.

    Raises
    ------
    DataError
        If sizes or names differ, time is missing or not regular, an input is not known, an output
        is infinite, or a factor is not positive; if `u` and `y` have indices of time that differ.

    Examples
    --------
    >>> u, y = [0.0, 1.0, 0.0], [0.0, 0.1, 0.3]
    >>> recording = from_arrays(u=u, y=y, dt=0.1, inputs={"F": "N"}, outputs={"q": "m"})
    >>> dict(recording.sizes)
    {'time': 3, 'input': 1, 'output': 1}
    """
    where = "recording"
    measured = _matrix(y, "y", outputs, where)
    nothing = u is None or (not inputs and is_named(u))
    known = np.empty((len(measured), 0)) if nothing else u
    given = _matrix(known, "u", inputs, where)
    lengths = {"u": len(given), "y": len(measured)}
    factors = None
    if sigma_factor is not None:
        factors = _matrix(sigma_factor, schema.SIGMA_FACTOR, outputs, where)
        lengths[schema.SIGMA_FACTOR] = len(factors)
    stamps, begin = _stamps(time, {"u": u, "y": y, schema.SIGMA_FACTOR: sigma_factor}, where)
    if stamps is not None:
        lengths["time"] = len(stamps)
    n = checks.check_lengths(lengths, where)
    return as_recording(
        time_axis(stamps, n, dt=dt, where=where),
        u=Group(given, inputs),
        y=Group(measured, outputs),
        sigma_factor=factors,
        dt=dt,
        resample=resample,
        grid=grid,
        begin=begin,
        where=where,
    )


def _stamps(time: Any, given: Mapping[str, Any], where: str) -> tuple[Array | None, str]:
    """Times [s] and the date of their zero, from `time` or from the index of what is given."""
    read = {
        name: seconds(index, time_format=None, where=f"{where}: {name}")
        for name, values in given.items()
        if (index := index_of(values)) is not None
    }
    for name, (own, begin) in read.items():
        first, (others, zero) = next(iter(read.items()))
        if begin != zero or not np.array_equal(own, others):
            raise DataError(
                f"{where}: {first} and {name} have indices of different times; bring them together "
                "first (reindex, or one recording each and merge)"
            )
    if time is None:
        return next(iter(read.values())) if read else (None, "")
    if is_quantity(time):
        time = in_seconds(np.asarray(time.magnitude), unit_of(time, ""))
    if isinstance(time, str):
        if not is_named(given["y"]):
            raise DataError(f"{where}: time is '{time}', but y has no columns by name")
        name, unit = time, unit_of(given["y"], time)
        time = named_columns(given["y"], [name], "y", where)[name]
        time = in_seconds(np.asarray(time), unit) if unit else time
    return seconds(time, time_format=epoch_form(time), where=where)


def time_axis(time: Array | None, n: int, *, dt: float | None, where: str) -> Array:
    """Time of every sample [s], (n,), from what is given; raises `DataError`."""
    if dt is not None:
        checks.check_period(dt, "dt", where)
    if time is not None:
        checks.check_time(time, where)
        return time
    if dt is None:
        raise DataError(f"{where}: give the column of time, or the sampling period dt")
    return dt * np.arange(n, dtype=float)


def as_recording(
    time: Array,
    *,
    u: Group,
    y: Group,
    x: Group | None = None,
    sigma_factor: Array | None = None,
    dt: float | None = None,
    resample: float | None = None,
    grid: float | None = None,
    first: int = 0,
    begin: str = "",
    understood: str = "",
    where: str,
) -> xr.Dataset:
    """Check a recording and put it together.

    Parameters
    ----------
    time : (n,) array
        Increasing time stamps [s].
    u, y, x : Group
        Inputs, outputs, and reference states if there are any.
    sigma_factor : (n, ny) array, optional
        See `from_arrays`.
    dt : float, optional
        Sampling period [s]; if not given, the mean interval.
    resample : float, optional
        Interpolate to this period [s]; time may then be irregular.
    grid : float, optional
        Put the samples on a grid of this period [s]; time may then be irregular.
    first : int
        Number of the first sample in the file, for messages.
    begin : str
        Date of the zero of time, if it is known.
    understood : str
        How the file was understood.
    where : str
        What messages begin with.
    """
    if resample is not None and grid is not None:
        raise DataError(f"{where}: give resample (interpolates) or grid (does not), not both")
    if resample is None and grid is None:
        even = checks.check_regular(time, dt, where)
        if even is not None:
            time = even.times(len(time))
            understood = "; ".join(filter(None, (understood, str(even))))
    elif resample is not None:
        checks.check_period(resample, "resample", where)
    checks.check_inputs(u.values, u.units, time, first=first, where=where)
    checks.check_measured(y.values, y.units, time, first=first, where=where)
    recording = schema.recording(
        time,
        u=u.values,
        y=y.values,
        inputs=dict(u.units),
        outputs=dict(y.units),
        dt=dt or (time[-1] - time[0]) / (len(time) - 1),
    )
    notes = {BEGIN: begin, UNDERSTOOD: understood}
    recording.attrs |= {name: text for name, text in notes.items() if text}
    if sigma_factor is not None:
        recording = with_sigma_factor(recording, sigma_factor, where=where)
    if x is not None:
        recording = with_truth(recording, x)
    if grid is not None:
        return to_grid(recording, grid)
    return recording if resample is None else resampled(recording, resample)


def with_truth(recording: xr.Dataset, x: Group) -> xr.Dataset:
    """Add reference states as ``x_true (time, state)``."""
    return recording.assign_coords(
        state=list(x.units), state_unit=("state", list(x.units.values()))
    ).assign(x_true=(("time", "state"), x.values))


def with_sigma_factor(recording: xr.Dataset, factor: Array, *, where: str) -> xr.Dataset:
    """Add ``sigma_factor (time, output)``, NaN in the place of infinity."""
    schema.check_sigma_factor(factor, recording["output"].values.tolist(), where)
    finite = np.where(np.isinf(factor), np.nan, factor)
    return recording.assign({schema.SIGMA_FACTOR: (("time", "output"), finite)})


def _matrix(values: Any, what: str, units: Mapping[str, str], where: str) -> Array:
    if is_named(values):
        columns = named_columns(values, units, what, where)
        lengths = {name: np.size(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            raise DataError(f"{where}: the columns of {what} have different lengths: {lengths}")
        numbers = [
            _converted(_numbers(c, f"{what}['{name}']", where), unit_of(values, name), units[name])
            for name, c in columns.items()
        ]
        values = np.stack(numbers, axis=1) if numbers else np.empty((0, 0))
    own = unit_of(values, what)
    matrix = _numbers(values.magnitude if is_quantity(values) else values, what, where)
    if matrix.ndim == 1 and len(units) == 1:
        matrix = matrix[:, None]
    if matrix.ndim != 2 or matrix.shape[1] != len(units):
        hint = " (transpose it)" if matrix.ndim == 2 and matrix.shape[0] == len(units) else ""
        raise DataError(
            f"{where}: {what} has the shape {matrix.shape}; it needs time as the first axis and "
            f"{len(units)} columns: {', '.join(units) or 'none'}{hint}"
        )
    if not own:
        return matrix
    each = zip(matrix.T, units.values(), strict=True)
    return np.stack([_converted(column, own, unit) for column, unit in each], axis=1)


def _converted(values: Array, own: str, unit: str) -> Array:
    """From the unit that data bring along to the one that is named, if there is a way."""
    return conversion(own, unit).applied(values) if unit and convertible(own, unit) else values


def _numbers(values: Any, what: str, where: str) -> Array:
    kind = np.asanyarray(values).dtype.kind
    if kind == "c":
        raise DataError(f"{where}: {what} is not an array of real numbers, but of complex ones")
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(np.ma.asarray(values, float), np.nan)
    if kind in "mM":  # would become nanoseconds, or ticks of any other length
        raise DataError(f"{where}: {what} is not an array of real numbers, but of dates")
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: {what} is not an array of real numbers: {error}") from None
