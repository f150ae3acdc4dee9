"""Translate how a paper starts."""

import numpy as np
import xarray as xr


def posterior_start(recording: xr.Dataset) -> xr.Dataset:
    """Translate a start in which the prior knowledge is the *posterior* of sample 0.

    Here the prior knowledge comes before the first measurement: without a measurement at sample 0
    the two are the same.
    """
    y = recording["y"].copy()
    y[0] = np.nan
    return recording.assign(y=y)
