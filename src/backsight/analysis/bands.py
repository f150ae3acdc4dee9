"""Ends of the bands of a result as they are drawn: of states, and of innovations."""

import numpy as np
import xarray as xr

from backsight.analysis.outliers import taken
from backsight.schema import LOWER, POSITIVE, UPPER
from backsight.types import Array


def state_band(result: xr.Dataset, name: str, *, deviations: float = 3.0) -> tuple[Array, Array]:
    """Both ends of the band of a state, (n,) each.

    Of a state that is estimated as a logarithm the estimate times and over a factor. Elsewhere what
    lies beyond a bound is cut off: P is that of the estimate without bounds.

    Parameters
    ----------
    result : xarray.Dataset
    name : str
    deviations : float
        Half the width in standard deviations.
    """
    x, std = (result[v].sel(state=name).values.astype(float) for v in ("x_hat", "x_std"))
    if name in str(result.attrs.get(POSITIVE, "")).split():
        with np.errstate(all="ignore"):
            factor = np.exp(deviations * std / x)
            return x / factor, x * factor
    low, high = x - deviations * std, x + deviations * std
    if LOWER in result.coords:
        lower, upper = (float(result[end].sel(state=name)) for end in (LOWER, UPPER))
        low, high = np.clip(low, lower, upper), np.clip(high, lower, upper)
    return low, high


def innovation_band(
    result: xr.Dataset, name: str, *, deviations: float = 3.0
) -> tuple[Array, Array]:
    """Innovation of an output and some of its standard deviations, (n,) each.

    The innovation is NaN where nothing was taken in: not measured, or left out by a rule for
    outliers. What it would have been judged by is known there, too.
    """
    i = list(result["output"].values).index(name)
    variance = result["S"].values[:, i, i]
    bound = deviations * np.sqrt(np.where(variance > 0, variance, np.nan))
    e = result["e"].values[:, i].astype(float)
    return np.where(taken(result).values[:, i], e, np.nan), bound
