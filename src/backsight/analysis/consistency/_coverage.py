r"""How often the bands hold the truth, and the size of errors measured with their covariance.

The normalised estimation error squared (NEES) :math:`(x - \hat x)^T P^{-1} (x - \hat x)` of a
consistent estimator has as mean the number of states whose truth is known. The errors of successive
samples are alike, unlike the innovations: the bounds count only as many samples as are independent.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation",
Wiley 2001, section 5.4, https://doi.org/10.1002/0471221279.
"""

import dataclasses
import math

import numpy as np
import scipy
import xarray as xr

from backsight.analysis.consistency._independent import independent_samples
from backsight.analysis.consistency.whiteness import normalised
from backsight.description import Printed
from backsight.types import Array

DEVIATIONS = (1.0, 2.0, 3.0)
"""Half widths of the bands."""

NORMAL = tuple(math.erf(d / math.sqrt(2.0)) for d in DEVIATIONS)
"""Share of a normal number within `DEVIATIONS`: 68.3, 95.4 and 99.7 %."""


@dataclasses.dataclass(frozen=True)
class MeanNees(Printed):
    """Mean of the normalised estimation error squared.

    Parameters
    ----------
    value : float
        NaN where no truth is known.
    expected : float
        Mean number of known states.
    band : (float, float)
        95 % interval of the mean of a consistent estimator.
    independent : float
        Number of samples that count as independent.
    """

    value: float
    expected: float
    band: tuple[float, float]
    independent: float


def nees(result: xr.Dataset) -> xr.DataArray:
    r"""Normalised estimation error squared over the states whose truth is known, (time,).

    Directions without variance (a singular P) are left out; ``NaN`` where no truth is known, and if
    P was not kept.
    """
    value, _ = _squares(result)
    return xr.DataArray(value, dims="time", coords={"time": result["time"]}, name="nees")


def mean_nees(result: xr.Dataset, level: float = 0.95) -> MeanNees:
    """Mean of `nees` with the interval in which it should lie; see `MeanNees`."""
    value, freedom = _squares(result)
    known = np.isfinite(value)
    if not known.any():
        return MeanNees(math.nan, math.nan, (math.nan, math.nan), 0.0)
    value, freedom = value[known], freedom[known]
    expected, count = float(freedom.mean()), independent_samples(value)
    tail = 0.5 * (1.0 - level)
    half = 0.5 * expected * count
    low, high = (2 * float(scipy.special.gammaincinv(half, q)) / count for q in (tail, 1 - tail))
    return MeanNees(float(value.mean()), expected, (low, high), count)


def coverage(result: xr.Dataset) -> xr.DataArray:
    """Share of the samples at which the truth lies within 1, 2 and 3 deviations of the estimate.

    Returns
    -------
    xarray.DataArray
        (deviations, state), 0 to 1; NaN where no truth is known. `NORMAL` is what it should be.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> bs.check.coverage(bs.estimate(kf, spring, recording, engine="vm")).dims
    ('deviations', 'state')
    """
    if "x_true" not in result:
        error = np.full(result["x_hat"].shape, np.nan)
    else:
        error = (result["x_true"] - result["x_hat"]).values
    std = result["x_std"].values
    size = np.abs(error) / np.where(std > 0, std, np.nan)
    return _shares(size, result["state"].values, "state")


def innovation_coverage(result: xr.Dataset) -> xr.DataArray:
    """Share of the innovations within 1, 2 and 3 of their deviations, (deviations, output)."""
    return _shares(np.abs(normalised(result)), result["output"].values, "output")


def shares_within(size: Array) -> Array:
    """Shares (deviations, m) of errors (n, m), in deviations, that are not larger than these.

    NaN is an error that is not known; of a column of these so are the shares.
    """
    known = np.isfinite(size)
    count = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
    return np.array([(np.where(known, size, np.inf) <= d).sum(axis=0) / count for d in DEVIATIONS])


def _shares(size: Array, names: Array, dim: str) -> xr.DataArray:
    coords = {"deviations": list(DEVIATIONS), dim: names}
    shares = shares_within(size)
    return xr.DataArray(shares, dims=("deviations", dim), coords=coords, name="coverage")


def _squares(result: xr.Dataset) -> tuple[Array, Array]:
    """NEES and the number of directions it counts, both (n,)."""
    n = result.sizes["time"]
    if "x_true" not in result or "P" not in result:  # P is kept in files on request only
        return np.full(n, np.nan), np.zeros(n)
    error = (result["x_true"] - result["x_hat"]).values
    std = result["x_std"].values
    known = np.isfinite(error) & np.isfinite(std) & (std > 0)
    scale = np.where(known, std, 1.0)
    pairs = known[:, :, None] & known[:, None, :]
    with np.errstate(over="ignore", invalid="ignore"):
        C = np.where(pairs, result["P"].values, 0.0) / scale[:, :, None] / scale[:, None, :]
    sound = np.logical_and(known.any(axis=1), np.isfinite(C).all(axis=(1, 2)))
    values, vectors = np.linalg.eigh(np.where(sound[:, None, None], C, 0.0))
    kept = np.asarray(values) > 1e-9
    with np.errstate(over="ignore", invalid="ignore"):
        along = np.einsum("kij,ki->kj", vectors, np.where(known, error, 0.0) / scale)
        squares = np.sum(np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0), axis=1)
    return np.where(sound & np.isfinite(squares), squares, np.nan), kept.sum(axis=1).astype(float)
