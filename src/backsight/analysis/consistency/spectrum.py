"""Innovations over the frequency."""

import numpy as np
import scipy
import xarray as xr

from backsight.analysis.consistency.whiteness import normalised
from backsight.types import Array

_SEGMENTS = 16  # of a recording, half of which overlap


def innovation_spectrum(result: xr.Dataset, output: str) -> tuple[Array, Array]:
    """Power spectral density of the normalised innovations of an output, by Welch's method.

    Parameters
    ----------
    result : xarray.Dataset
        A result with its sampling period.
    output : str
        Samples without a measurement count as 0.

    Returns
    -------
    tuple of (m,) array
        Frequencies [Hz] without 0 and without the highest one, and the density by that of white
        noise of variance 1.
    """
    column = list(result["output"].values).index(output)
    r = np.nan_to_num(normalised(result)[:, column])
    rate = 1.0 / float(result.attrs["dt"])
    segment = max(len(r) * 2 // (_SEGMENTS + 1), 8)
    f, density = scipy.signal.welch(r, rate, nperseg=min(segment, len(r)))
    return f[1:-1], density[1:-1] * rate / 2.0  # one-sided: white noise has 2 / rate
