"""Change the sampling period of a recording."""

import numpy as np
import xarray as xr

from backsight.data._checks import check_period
from backsight.description import checked
from backsight.errors import DataError
from backsight.types import Array

SAME = 1e-6
"""Times closer than this, in periods, are the same time."""


@checked(DataError)
def resample(recording: xr.Dataset, dt: float) -> xr.Dataset:
    """Interpolate a recording linearly to another sampling period.

    A new sample between two of which one is missing (``NaN``) is missing. There is no
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
    signals = {
        name: (variable.dims, _interpolated(_snapped(new, old, dt), old, variable.to_numpy()))
        for name, variable in recording.data_vars.items()
    }
    fixed = {name: c for name, c in recording.coords.items() if "time" not in c.dims}
    return xr.Dataset(
        signals,
        coords={**fixed, "time": ("time", new, recording.time.attrs)},
        attrs={**recording.attrs, "dt": float(dt)},
    )


def _snapped(new: Array, old: Array, dt: float) -> Array:
    """Remove rounding: beside a missing sample, interpolation needs the exact time."""
    nearest = old[np.searchsorted((old[1:] + old[:-1]) / 2, new)]
    return np.where(np.abs(nearest - new) < SAME * dt, nearest, new)


def _interpolated(new: Array, old: Array, values: Array) -> Array:
    columns = [np.interp(new, old, column) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.empty((len(new), 0))
