"""Change the sampling period of a recording."""

import math

import numpy as np
import xarray as xr

from backsight.data._checks import check_period
from backsight.data._room import check_room
from backsight.description import checked
from backsight.errors import DataError
from backsight.schema import SAME
from backsight.types import Array

MOST_MOVED = 0.1
"""How far a sample may be moved to a grid, by the usual interval."""

MOST_SAMPLES = 1e15
"""Samples whose times can still be told from each other."""

GAP = 3.0
"""Samples further apart than this, in periods, have lost some between them."""


@checked(DataError)
def resample(recording: xr.Dataset, dt: float) -> xr.Dataset:
    """Interpolate a recording linearly to another sampling period.

    A new sample between two of which one is missing (``NaN``) is missing, and so is an output in a
    gap, that is, in an interval of more than three periods, old and new; an input goes on along a
    line there, which the attribute ``understood`` says. There is no
    anti-aliasing filter: before going to a longer period, remove what is faster than half the new
    rate. The factors of the noise of single samples are interpolated, too, which is no less than
    the noise of the new samples.

    Parameters
    ----------
    recording : xarray.Dataset
        Its time must increase but may be irregular.
    dt : float
        New sampling period [s].

    Returns
    -------
    xarray.Dataset
        From the first time stamp in steps of `dt`, as far as the recording goes.

    Raises
    ------
    DataError
        If `dt` is not positive, the recording is shorter than one period, or the new one would not
        fit into memory.

    Examples
    --------
    >>> import numpy as np
    >>> recording = bs.data.from_arrays(
    ...     inputs={}, y=np.arange(11.0)[:, None], dt=0.1, outputs={"y": "m"}
    ... )
    >>> bs.resample(recording, 0.25).y.values.ravel()
    array([ 0. ,  2.5,  5. ,  7.5, 10. ])
    """
    check_period(dt, "the sampling period", "resample")
    old = recording.time.to_numpy()
    n = _count(recording, dt, "resample")
    if n < 2:
        raise DataError(f"resample: the recording is shorter than the sampling period of {dt:g} s")
    new = old[0] + dt * np.arange(n)
    at = _snapped(new, old, dt)
    within = _in_gap(at, old, dt)
    signals = {}
    for name, variable in recording.data_vars.items():
        values = _interpolated(at, old, variable.to_numpy())
        if name != "u":
            values[within] = np.nan
        signals[name] = (variable.dims, values)
    attrs = {**recording.attrs, "dt": float(dt)}
    if within.any() and recording.sizes["input"]:
        note = f"inputs go along a line through {within.sum()} samples in gaps"
        attrs["understood"] = "; ".join(filter(None, (attrs.get("understood", ""), note)))
    fixed = {name: c for name, c in recording.coords.items() if "time" not in c.dims}
    return xr.Dataset(
        signals,
        coords={**fixed, "time": ("time", new, recording.time.attrs)},
        attrs=attrs,
    )


@checked(DataError)
def to_grid(recording: xr.Dataset, dt: float) -> xr.Dataset:
    """Put the samples of a recording on an even grid, with nothing measured between them.

    Nothing is interpolated: an output is ``NaN`` at the times of the grid without a sample, so that
    its noise stays what it is, and an input holds its last value. It is the exact way for
    recordings with gaps (`dt` is then their period) and irregular times (`dt` is then a fraction of
    the intervals).

    Parameters
    ----------
    recording : xarray.Dataset
        Its time must increase but may be irregular.
    dt : float
        Period of the grid [s], which begins with the first sample.

    Returns
    -------
    xarray.Dataset
        By how much samples were moved at most, the attribute ``understood`` says.

    Raises
    ------
    DataError
        If `dt` is not positive, so long that samples would be moved by more than a tenth of their
        usual interval, or so short that the grid would not fit into memory.

    Examples
    --------
    >>> from backsight.data import from_arrays
    >>> time, y = [0.0, 1.0, 4.0], [0.0, 0.1, 0.4]
    >>> recording = from_arrays(y=y, time=time, grid=1.0, inputs={}, outputs={"q": "m"})
    >>> recording.y.values.ravel()
    array([0. , 0.1, nan, nan, 0.4])
    """
    check_period(dt, "the period of the grid", "to_grid")
    old = recording.time.to_numpy()
    _count(recording, dt, "to_grid")
    place = np.rint((old - old[0]) / dt).astype(np.int64)
    moved = np.abs(old - (old[0] + dt * place))
    k, usual = int(np.argmax(moved)), float(np.median(np.diff(old)))
    double = np.diff(place) == 0
    if moved[k] > MOST_MOVED * usual or double.any():
        raise DataError(
            f"to_grid: with a period of {dt:g} s the sample at {old[k]:.9g} s would be moved by "
            f"{moved[k]:.3g} s, and the samples are {usual:.6g} s apart; give a shorter period, "
            f"{2 * MOST_MOVED * usual:.3g} s will do"
        )
    n = int(place[-1]) + 1
    held = np.searchsorted(place, np.arange(n), side="right") - 1
    signals = {}
    for name, variable in recording.data_vars.items():
        values = variable.to_numpy()
        spread = np.full((n, *values.shape[1:]), np.nan)
        spread[place] = values
        signals[name] = (variable.dims, values[held] if name == "u" else spread)
    note = f"{len(old)} samples on a grid of {n}, moved by {moved[k]:.2g} s at most"
    understood = "; ".join(filter(None, (recording.attrs.get("understood", ""), note)))
    fixed = {name: c for name, c in recording.coords.items() if "time" not in c.dims}
    new = old[0] + dt * np.arange(n)
    return xr.Dataset(
        signals,
        coords={**fixed, "time": ("time", new, recording.time.attrs)},
        attrs={**recording.attrs, "dt": float(dt), "understood": understood},
    )


def _count(recording: xr.Dataset, dt: float, where: str) -> int:
    """How many samples there will be in steps of `dt`; not a byte is taken for them before."""
    span = float(recording.time[-1]) - float(recording.time[0])
    steps = span / dt  # of Python's floats: infinity, where NumPy would warn
    if not steps < MOST_SAMPLES:
        raise DataError(
            f"{where}: steps of {dt:g} s over {span:.6g} s are {steps:.3g} samples, and no more "
            f"than {MOST_SAMPLES:.0e} can be counted; give a longer period"
        )
    n = int(steps + SAME) + 1
    columns = 1 + sum(math.prod(v.shape[1:]) for v in recording.data_vars.values())
    check_room(n * 8 * columns, f"{where}: with a period of {dt:g} s the recording")
    return n


def _in_gap(at: Array, old: Array, dt: float) -> np.ndarray:
    """Which of the new times are in an interval where samples were lost, (n,) of bool."""
    after = np.clip(np.searchsorted(old, at), 1, len(old) - 1)
    step = old[after] - old[after - 1]
    inside = (at > old[after - 1]) & (at < old[after])
    return inside & (step > GAP * max(float(np.median(np.diff(old))), dt))


def _snapped(new: Array, old: Array, dt: float) -> Array:
    """Remove rounding: beside a missing sample, interpolation needs the exact time."""
    nearest = old[np.searchsorted((old[1:] + old[:-1]) / 2, new)]
    return np.where(np.abs(nearest - new) < SAME * dt, nearest, new)


def _interpolated(new: Array, old: Array, values: Array) -> Array:
    columns = [np.interp(new, old, column) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.empty((len(new), 0))
