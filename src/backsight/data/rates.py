"""Change the rate of a recording, and bring recordings of several rates together."""

import numpy as np
import xarray as xr

from backsight.data import checks
from backsight.errors import DataError
from backsight.types import Array

SIGNALS = {"u": "input", "y": "output", "x_true": "state"}
"""Variables of a recording and the dimension that names their columns."""


def resample(recording: xr.Dataset, dt: float) -> xr.Dataset:
    """Interpolate a recording linearly to another sampling period.

    A new sample between two of which one is missing (``NaN``) is missing. There is no
    anti-aliasing filter: before going to a longer period, filter what is faster than half the new
    rate.

    Parameters
    ----------
    recording : xarray.Dataset
        Its time may be irregular, but must increase.
    dt : float
        New sampling period [s].

    Returns
    -------
    xarray.Dataset
        From the first time stamp on, in steps of `dt`, as far as the recording goes.

    Raises
    ------
    DataError
        If `dt` is not positive or the recording is shorter than one period.
    """
    checks.check_period(dt, "the sampling period", "resample")
    old = recording.time.to_numpy()
    # A whole number of periods must not lose its last sample to rounding.
    n = int((old[-1] - old[0]) / dt * (1 + 1e-12)) + 1
    if n < 2:
        raise DataError(f"resample: the recording is shorter than the sampling period of {dt:g} s")
    new = old[0] + dt * np.arange(n)
    signals = {k: _interpolated(new, old, recording[k].to_numpy()) for k in _signals(recording)}
    return _with(recording, new, signals).assign_attrs(dt=float(dt))


def merge(*recordings: xr.Dataset) -> xr.Dataset:
    """Bring recordings of one experiment, made at several rates, on the fastest time grid.

    An output of a slower recording is ``NaN`` where it was not measured, an input holds its last
    value. A slower sample goes to the nearest time of the grid, an error of half the fast period
    at most; where that matters, `resample` first. The result covers the time that all recordings
    cover.

    Parameters
    ----------
    *recordings : xarray.Dataset
        With different names for all signals, and one common zero of time.

    Raises
    ------
    DataError
        If a name occurs twice, the recordings do not overlap, or two samples of a slower one fall
        on one time.
    """
    if not recordings:
        raise DataError("merge: give at least one recording")
    for dimension in SIGNALS.values():
        names = [n for r in recordings if dimension in r for n in r[dimension].to_numpy().tolist()]
        for name in names:
            if names.count(name) > 1:
                raise DataError(f"merge: two recordings have an {dimension} '{name}'; rename one")
    fastest = min(recordings, key=lambda r: r.attrs["dt"])
    time = _overlap(recordings, fastest.time.to_numpy(), fastest.attrs["dt"])
    merged = xr.merge([_on_grid(r, time, fastest.attrs["dt"]) for r in recordings])
    return merged.assign_attrs(fastest.attrs)
