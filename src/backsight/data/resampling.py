"""Change the sampling period of a recording."""

import numpy as np
import xarray as xr

from backsight.data._checks import check_period
from backsight.description import checked
from backsight.errors import DataError
from backsight.types import Array

SAME = 1e-6
"""Times closer than this, in periods, are the same time."""

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
        If `dt` is not positive or the recording is shorter than one period.
    """
    check_period(dt, "the sampling period", "resample")
    old = recording.time.to_numpy()
    n = int((old[-1] - old[0]) / dt + SAME) + 1
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
