"""From arrays to a checked recording."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from backsight import schema
from backsight.data import _checks as checks
from backsight.data.resampling import resample as resampled
from backsight.errors import DataError
from backsight.types import Array


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
    u: ArrayLike | None = None,
    y: ArrayLike,
    inputs: Mapping[str, str],
    outputs: Mapping[str, str],
    time: ArrayLike | None = None,
    dt: float | None = None,
    resample: float | None = None,
    sigma_factor: ArrayLike | None = None,
) -> xr.Dataset:
    """Make a recording of arrays.

    Parameters
    ----------
    u, y : (n, nu) and (n, ny) arrays, or (n,) for a single signal
        Inputs and outputs; ``NaN`` in `y` is "not measured". Without inputs, leave out `u`.
    inputs, outputs : dict
        Name to unit of every column, in order.
    time : (n,) array, optional
        Time of every sample [s].
    dt : float, optional
        Sampling period [s]; needed if there is no `time`.
    resample : float, optional
        Interpolate to this sampling period [s]; see `backsight.data.resample`.
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
        If sizes differ, time is missing or not regular, an input is not known, an output is
        infinite, or a factor is not positive.

    Examples
    --------
    >>> u, y = [0.0, 1.0, 0.0], [0.0, 0.1, 0.3]
    >>> recording = from_arrays(u=u, y=y, dt=0.1, inputs={"F": "N"}, outputs={"q": "m"})
    >>> dict(recording.sizes)
    {'time': 3, 'input': 1, 'output': 1}
    """
    where = "recording"
    measured = _matrix(y, "y", outputs, where)
    known = np.empty((len(measured), 0)) if u is None else u
    given = _matrix(known, "u", inputs, where)
    lengths = {"u": len(given), "y": len(measured)}
    factors = None
    if sigma_factor is not None:
        factors = _matrix(sigma_factor, schema.SIGMA_FACTOR, outputs, where)
        lengths[schema.SIGMA_FACTOR] = len(factors)
    stamps = None if time is None else _matrix(time, "time", {"time": "s"}, where)[:, 0]
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
        where=where,
    )


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
    first: int = 0,
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
    first : int
        Number of the first sample in the file, for messages.
    where : str
        What messages begin with.
    """
    if resample is None:
        checks.check_regular(time, dt, where)
    else:
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
    if sigma_factor is not None:
        recording = with_sigma_factor(recording, sigma_factor, where=where)
    if x is not None:
        recording = with_truth(recording, x)
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


def _matrix(values: ArrayLike, what: str, units: Mapping[str, str], where: str) -> Array:
    try:
        matrix = np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: {what} is not an array of real numbers: {error}") from None
    if matrix.ndim == 1 and len(units) == 1:
        matrix = matrix[:, None]
    if matrix.ndim != 2 or matrix.shape[1] != len(units):
        raise DataError(
            f"{where}: {what} has the shape {matrix.shape}; it needs time as the first axis and "
            f"{len(units)} columns: {', '.join(units) or 'none'}"
        )
    return matrix
