r"""Whether innovations are white, and whether the inputs explain them.

With the right model and the right noise the normalised innovations :math:`r_k = e_k / \sqrt{S_k}`
of an output are independent of each other and of all inputs before them. Products
:math:`r_k r_{k-l}` then have mean zero, and :math:`\sum r_k r_{k-l}` divided by the root of
:math:`\sum r_k^2 r_{k-l}^2` is a standard normal number, also if the variance of the innovations
is not what the estimator believes, or changes. Pairs with a sample that was not measured are left
out.

Sources: Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE
Transactions on Automatic Control 15(2), 1970, https://doi.org/10.1109/TAC.1970.1099422; Ljung, Box,
"On a measure of lack of fit in time series models", Biometrika 65(2), 1978,
https://doi.org/10.1093/biomet/65.2.297.
"""

import dataclasses
import math

import numpy as np
import scipy
import xarray as xr

from backsight.analysis.consistency._input_noise import noise_of_inputs
from backsight.analysis.consistency._projection import orthonormal, without
from backsight.analysis.outliers import taken
from backsight.description import Printed
from backsight.schema import INNOVATIONS
from backsight.types import Array

LAGS = 20
"""Most lags of the portmanteau test, if there are so many times `PER_LAG` samples."""

PER_LAG = 30
"""Samples for each lag: with fewer, white innovations are doubted more often than they should."""

PAST = 10
"""Samples back to which inputs are searched for what explains the innovations."""

OWN_PAST = 30
"""Samples back to which innovations that are not white by nature explain themselves."""

WIDEST = 4.0
"""Innovations beyond so many of their own deviations are cut: a few of them must not decide."""


@dataclasses.dataclass(frozen=True)
class Colour(Printed):
    """What is left in the innovations of one output.

    Parameters
    ----------
    output : str
    lag1 : float
        Correlation of successive innovations.
    largest : float
        Correlation of those at the distance where it is largest.
    lag : int
        That distance [samples of this output that were measured].
    p_white : float
        Probability that white innovations look at least so little white (Ljung-Box); NaN if there
        are too few.
    explained : float
        Share of their variance that past inputs explain, 0 to 1.
    p_input : float
        Probability of at least such a share if the inputs have nothing to do with them; NaN if
        there are no inputs, or too few samples.
    input, delay : str, int
        Input, and the number of samples since it, with the largest correlation; "" and 0 if there
        are no inputs.
    noise, p_noise : float
        Share that the unpredictable part of past inputs explains, its noise, and the probability of
        at least such a share by chance; NaN if that cannot be told, see `_input_noise`.
    noisy : str
        The input with the largest such share; "" if there are no inputs.
    """

    output: str
    lag1: float
    largest: float
    lag: int
    p_white: float
    explained: float
    p_input: float
    input: str
    delay: int
    noise: float = math.nan
    p_noise: float = math.nan
    noisy: str = ""


def colours(result: xr.Dataset) -> tuple[Colour, ...]:
    """What is left in the innovations, per output."""
    r, (u, inputs) = normalised(result), _inputs(result)
    outputs = [str(n) for n in result["output"].values]
    own = PAST if result.attrs.get(INNOVATIONS, "white") == "white" else OWN_PAST
    return tuple(_colour(name, r[:, i], u, inputs, own) for i, name in enumerate(outputs))


def normalised(result: xr.Dataset) -> Array:
    """Innovations per standard deviation, (n, ny); NaN where not measured or S is no variance."""
    variance = np.einsum("kii->ki", result["S"].values)
    known = taken(result).values & (variance > 0) & np.isfinite(variance)
    deviation = np.sqrt(np.where(known, variance, 1.0))
    with np.errstate(over="ignore"):
        r = np.where(known, result["e"].values / deviation, np.nan)
    return np.where(np.isfinite(r), r, np.nan)


def autocorrelation(result: xr.Dataset, lags: int = LAGS, *, level: float = 0.95) -> xr.Dataset:
    """Correlation of the innovations of every output with those before them.

    Parameters
    ----------
    result : xarray.Dataset
        A result.
    lags : int
        Largest distance [samples].
    level : float
        Probability of the bound.

    Returns
    -------
    xarray.Dataset
        ``correlation`` and ``bound``, each (lag, output), for lag 1 ... `lags`: a white sequence
        stays between -bound and bound with probability `level`, lag by lag. NaN if there are no
        pairs.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 80, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=0.1))
    >>> found = bs.check.autocorrelation(bs.estimate(kf, spring, recording, engine="vm"), lags=3)
    >>> found.sizes["lag"]
    3
    """
    r = normalised(result)
    found = [_products(_cut(r[:, i]), lags) for i in range(r.shape[1])]
    quantile = scipy.special.ndtri(0.5 + 0.5 * level)
    dims = ("lag", "output")
    return xr.Dataset(
        {
            "correlation": (dims, np.column_stack([c for c, _ in found])),
            "bound": (dims, np.column_stack([quantile * s for _, s in found])),
        },
        coords={"lag": np.arange(1, lags + 1), "output": result["output"].values},
    )


def cross_correlation(result: xr.Dataset, reach: int = PAST, *, level: float = 0.95) -> xr.Dataset:
    """Correlation of the innovations with past and future inputs.

    Parameters
    ----------
    result : xarray.Dataset
        A result.
    reach : int
        Samples to go back and ahead.
    level : float
        Probability of the bound.

    Returns
    -------
    xarray.Dataset
        ``correlation`` and ``bound``, each (lag, output, input), for lag -reach ... reach: at a
        positive lag the input is so many samples older than the innovation. Correlation with past
        inputs means that the model answers them wrongly; correlation with the present or future
        ones, that y runs ahead of u, or that a controller feeds y back.
    """
    r, (u, inputs) = normalised(result), _inputs(result)
    lags = np.arange(-reach, reach + 1)
    shape = (len(lags), r.shape[1], u.shape[1])
    correlation, bound = np.full(shape, np.nan), np.full(shape, np.nan)
    quantile = scipy.special.ndtri(0.5 + 0.5 * level)
    for i in range(shape[1]):
        e = _cut(r[:, i])
        for j in range(shape[2]):
            v = u[:, j] - u[:, j].mean()
            for k, lag in enumerate(lags):
                correlation[k, i, j], deviation = _correlated(*_pairs(e, v, int(lag)))
                bound[k, i, j] = quantile * deviation
    dims = ("lag", "output", "input")
    return xr.Dataset(
        {"correlation": (dims, correlation), "bound": (dims, bound)},
        coords={"lag": lags, "output": result["output"].values, "input": inputs},
    )


def _colour(name: str, r: Array, u: Array, inputs: list[str], own: int) -> Colour:
    e = _cut(r)
    measured = e[np.isfinite(e)]
    lags = min(LAGS, len(measured) // PER_LAG)
    # A sensor that is slower than the recording has no pairs at most distances in time.
    correlation, deviation = _products(measured, max(lags, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        scores = (correlation / deviation) ** 2
    sound = np.isfinite(scores)
    few = lags < 1 or not sound.any()
    p_white = math.nan if few else float(scipy.special.chdtrc(sound.sum(), scores[sound].sum()))
    at = int(np.argmax(np.where(sound, np.abs(correlation), 0.0)))
    explained, p_input, (column, delay) = _explained(e, u, own)
    noise = noise_of_inputs(e, u, own)
    return Colour(
        output=name,
        lag1=float(correlation[0]),
        largest=float(correlation[at]),
        lag=at + 1,
        p_white=p_white,
        explained=explained,
        p_input=p_input,
        input=inputs[column] if delay else "",
        delay=delay,
        noise=noise.share,
        p_noise=noise.p,
        noisy=inputs[noise.input] if inputs else "",
    )


def _inputs(result: xr.Dataset) -> tuple[Array, list[str]]:
    """Inputs (n, nu) and their names; none if the result has none."""
    if "u" not in result:
        return np.empty((result.sizes["time"], 0)), []
    return result["u"].values, [str(n) for n in result["input"].values]


def _cut(r: Array) -> Array:
    """In units of the median of the sizes, what is far outside limited."""
    if not np.isfinite(r).any():
        return r
    size = 1.4826 * np.nanmedian(np.abs(r))
    return np.clip(r / size, -WIDEST, WIDEST) if size > 0 else 0.0 * r


def _products(r: Array, lags: int) -> tuple[Array, Array]:
    """Correlations at lag 1 ... lags and their standard deviations if r is white."""
    found = [_correlated(*_pairs(r, r, lag)) for lag in range(1, lags + 1)]
    correlation, deviation = np.array(found).T
    return correlation, deviation


def _pairs(a: Array, b: Array, lag: int) -> tuple[Array, Array]:
    """``a[k]`` and ``b[k - lag]`` where both are known."""
    n = len(a)
    later, earlier = a[max(lag, 0) : n + min(lag, 0)], b[max(-lag, 0) : n - max(lag, 0)]
    known = np.isfinite(later) & np.isfinite(earlier)
    return later[known], earlier[known]


def _correlated(a: Array, b: Array) -> tuple[float, float]:
    """Correlation of two columns of mean zero, and its deviation if there is none."""
    size = math.sqrt(float(a @ a) * float(b @ b))
    if size == 0:
        return math.nan, math.nan
    return float(a @ b) / size, math.sqrt(float((a * a) @ (b * b))) / size


def _explained(e: Array, u: Array, memory: int) -> tuple[float, float, tuple[int, int]]:
    """Share that the inputs of the last samples explain, its probability, and (input, delay).

    It is what they explain beyond the innovations' own past. A gain that does not fit the noise
    makes innovations predictable from their own past, and a controller then carries them over to
    the inputs; neither is a fault of the model. The input at the same sample is left out: a
    controller may have made it from this very output.
    """
    n, nu = u.shape
    first = max(PAST, memory)
    rows = np.flatnonzero(np.isfinite(e[first:])) + first if n > first else np.empty(0, int)
    if nu == 0 or len(rows) < 20 * PAST * (nu + 1):
        return math.nan, math.nan, (0, 0)
    past, v, z = np.nan_to_num(e), u - u.mean(axis=0), e[rows]
    own = np.column_stack([past[rows - lag] for lag in range(1, memory + 1)])
    inputs = np.column_stack([v[rows - lag] for lag in range(1, PAST + 1)])
    z, inputs = without(own, z), without(own, inputs)
    total, basis = float(z @ z), orthonormal(inputs)
    if basis.shape[1] == 0 or total == 0:
        return 0.0, math.nan, (0, 0)
    share = float(np.sum((basis.T @ z) ** 2)) / total
    left = len(rows) - own.shape[1] - basis.shape[1]
    p = float(scipy.special.betaincc(0.5 * basis.shape[1], 0.5 * left, share))
    size = np.sqrt((inputs**2).sum(axis=0))
    strength = np.abs(inputs.T @ z) / np.where(size > 0, size, np.inf)
    lag, column = divmod(int(strength.argmax()), nu)
    return share, p, (column, lag + 1)
