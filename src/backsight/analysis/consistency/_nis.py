r"""Agreement of an estimator's covariance with the errors it makes.

The normalised innovation squared :math:`e_k^T S_k^{-1} e_k` of a consistent estimator is chi-square
distributed, with as many degrees of freedom as channels were measured at that sample. Larger means
over-confident (the bands are too narrow), smaller means too cautious.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation",
Wiley 2001, section 5.4, https://doi.org/10.1002/0471221279.
"""

import math

import numpy as np
import scipy
import xarray as xr

from backsight.analysis.consistency._independent import independent_samples
from backsight.analysis.outliers import taken
from backsight.errors import DataError
from backsight.schema import INNOVATIONS
from backsight.types import Array

LARGEST = 1e100
"""A larger NIS counts as this: squares of it must stay finite."""


def measured_channels(result: xr.Dataset) -> xr.DataArray:
    """Return the number of outputs measured, and not left out, at every sample, (time,)."""
    return taken(result).sum("output")


def nis(result: xr.Dataset) -> xr.DataArray:
    r"""Normalised innovation squared :math:`e^T S^{-1} e` of the measured channels, (time,).

    Parameters
    ----------
    result : xarray.Dataset
        A result; ``NaN`` in ``y`` takes the channel out.

    Returns
    -------
    xarray.DataArray
        ``NaN`` where nothing was measured, or where `S` is not finite and positive definite.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> bs.check.nis(bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")).sizes["time"]
    80
    """
    squares, _ = _whitened(result)
    return _over_time(result, squares, "nis")


def log_likelihood(result: xr.Dataset) -> xr.DataArray:
    r"""Logarithm of the normal density of the innovation of every sample, (time,).

    :math:`-\tfrac12 (e^T S^{-1} e + \ln\det S + m \ln 2\pi)` over the `m` measured channels;
    ``NaN`` in the same places as `nis`. It depends on the units of the outputs: compare estimators
    on one recording, not recordings with each other.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> float(bs.check.log_likelihood(result).mean()) > 4.0
    True
    """
    squares, log_det = _whitened(result)
    channels = measured_channels(result).values
    value = -0.5 * (squares + log_det + channels * math.log(2.0 * math.pi))
    return _over_time(result, value, "log_likelihood")


def mean_nis(result: xr.Dataset) -> float:
    """Mean of `nis`; its expectation is the (mean) number of measured channels.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> 0.6 < bs.check.mean_nis(result) < 1.4
    True
    """
    return float(nis(result).mean("time"))


def nis_band(result: xr.Dataset, level: float = 0.95) -> tuple[float, float]:
    """Interval in which `mean_nis` of a consistent estimator lies with probability `level`.

    The sum of the NIS of white innovations is chi-square with the total number of measured
    channels as degrees of freedom. Of innovations that are not white by nature (see
    `schema.Innovations`) only as many samples count as are independent. ``(NaN, NaN)`` if no sample
    has a NIS.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> [round(end, 2) for end in bs.check.nis_band(result)]
    [0.71, 1.33]
    """
    values = nis(result).values
    valid = np.isfinite(values)
    channels, samples = measured_channels(result).values[valid], float(valid.sum())
    white = result.attrs.get(INNOVATIONS, "white") == "white"
    share = 1.0 if white or not samples else independent_samples(values[valid]) / samples
    freedom = np.array([share * channels.sum()])
    low, high = _mean_band(freedom, np.array([share * samples]), level)
    return float(low[0]), float(high[0])


def windowed_nis(result: xr.Dataset, window: int, *, level: float = 0.95) -> xr.Dataset:
    """Mean NIS of successive windows, with the interval for each.

    Parameters
    ----------
    result : xarray.Dataset
        A result.
    window : int
        Samples per window; the last one may be shorter. Windows do not overlap, so that their
        means are independent: one in twenty lies outside its 95 % interval by chance.
    level : float
        Probability of the interval.

    Returns
    -------
    xarray.Dataset
        ``nis``, ``lower``, ``upper``, each (time,), at the middle of every window; ``NaN`` in
        windows without measurements.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> list(bs.check.windowed_nis(result, 20).data_vars)
    ['nis', 'lower', 'upper']
    """
    if window < 1:
        raise DataError(f"the window has {window} samples; it needs at least one")
    values, channels = nis(result).values, measured_channels(result).values
    valid = np.isfinite(values)
    starts = np.arange(0, len(values), window)
    total, samples, freedom = (
        np.add.reduceat(v, starts)
        for v in (np.where(valid, values, 0.0), valid.astype(int), np.where(valid, channels, 0))
    )
    mean = np.where(samples > 0, total / np.maximum(samples, 1), np.nan)
    low, high = _mean_band(freedom, samples, level)
    time = result["time"].values
    ends = np.minimum(starts + window, len(time)) - 1
    return xr.Dataset(
        {"nis": ("time", mean), "lower": ("time", low), "upper": ("time", high)},
        coords={"time": 0.5 * (time[starts] + time[ends])},
    )


def _mean_band(freedom: Array, samples: Array, level: float) -> tuple[Array, Array]:
    tail = 0.5 * (1.0 - level)
    known = np.where(samples > 0, samples, np.nan)
    # The quantile of the chi-square distribution; scipy.stats takes a second to import.
    half = np.maximum(freedom, 1) / 2
    low, high = (2 * scipy.special.gammaincinv(half, q) / known for q in (tail, 1.0 - tail))
    return low, high


def _whitened(result: xr.Dataset) -> tuple[Array, Array]:
    """Return e' S^-1 e and ln det S over the measured channels, each (n,).

    A channel that was not measured becomes an independent one with unit variance and zero
    innovation, which adds nothing to either. `S` is brought to unit diagonal first: outputs may
    differ by ten orders of magnitude, their variances by twenty.
    """
    measured = taken(result).values
    e = np.where(measured, result["e"].values, 0.0)
    pairs = measured[:, :, None] & measured[:, None, :]
    unit = np.eye(measured.shape[1])
    S = np.where(pairs, result["S"].values, unit)
    variance = np.einsum("kii->ki", S)
    usable = (
        measured.any(axis=1)
        & np.isfinite(e).all(axis=1)
        & np.isfinite(S).all(axis=(1, 2))
        & (variance > 0).all(axis=1)
    )
    scale = np.where(usable[:, None], np.sqrt(np.where(variance > 0, variance, 1.0)), 1.0)
    # Divided twice: the product of two variances may leave the range of numbers.
    with np.errstate(over="ignore"):
        C = np.where(usable[:, None, None], S, unit) / scale[:, :, None] / scale[:, None, :]
    usable &= np.isfinite(C).all(axis=(1, 2))
    C = np.where(usable[:, None, None], C, unit)
    eigenvalues, axes = np.linalg.eigh(C)
    # Correlations of one but for rounding would be no number, or any.
    usable &= eigenvalues[:, 0] > unit.shape[0] * np.finfo(float).eps

    spread = np.where(usable[:, None], eigenvalues, 1.0)
    z = np.where(usable[:, None], e, 0.0) / scale
    with np.errstate(over="ignore", invalid="ignore"):  # what is no number counts as the largest
        squares = np.sum(np.einsum("kji,kj->ki", axes, z) ** 2 / spread, axis=1)
    squares = np.nan_to_num(np.minimum(squares, LARGEST), nan=LARGEST)
    log_det = np.sum(np.log(spread) + 2.0 * np.log(scale), axis=1)
    return np.where(usable, squares, np.nan), np.where(usable, log_det, np.nan)


def _over_time(result: xr.Dataset, values: Array, name: str) -> xr.DataArray:
    return xr.DataArray(values, dims="time", coords={"time": result["time"]}, name=name)
