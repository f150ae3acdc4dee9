"""Choose the weight of the l1 norm without knowing the forces."""

import dataclasses

import numpy as np
import scipy
import xarray as xr

from backsight.description import Count, Level, Printed, Whole, checked
from backsight.errors import DataError
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.estimation import match
from backsight.sparse import ForceSearch, refit
from backsight.tune._force_path import check_draws, unweighted, weights_of_noise, whole_path
from backsight.types import Array

LEAST = 1e-2
"""Smallest weight that is considered, as a share of the one from which on nothing is found."""

LAGS = 5
"""Lags at which the residuals must not be correlated."""


@dataclasses.dataclass(frozen=True)
class LambdaChoice(Printed):
    """A weight, and what speaks for it.

    Parameters
    ----------
    lam : float
        For `CompressiveSensingMHE.lam`.
    table : xarray.Dataset
        What was compared, over ``lam``.
    reached : bool
        Whether the goal was reached; else the weight is the one that comes nearest.
    """

    lam: float
    table: xr.Dataset
    reached: bool


@checked()
def lambda_from_noise(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    false_alarm: float = 0.05,
    draws: int = 400,
    seed: Whole = 0,
) -> LambdaChoice:
    r"""Weight at which noise alone seldom makes a force.

    Of a recording of noise with the stated deviations, and of background forces, the l1 norm finds
    something if :math:`2 \max_i |h_i' v| > \lambda`. The weight is the quantile of this number over
    random v. It holds for the whole recording, and so for every window of it; if the model is wrong
    it is too small, see `lambda_from_whiteness`.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is not used.
    model : Model
    recording : xarray.Dataset
        Only its length, and where it was not measured, matter.
    false_alarm : float
        Probability of one or more forces in a recording in which none acts.
    draws, seed : int
        Recordings of noise that are drawn.

    Returns
    -------
    LambdaChoice
        ``table`` has ``false_alarm``, the share of the drawn recordings in which a force is found,
        over ``lam``. `reached` is always true.

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`, or if `false_alarm` is not a probability.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_from_noise(finder, rod, recording, draws=20).lam > 0
    True
    """
    check_draws(false_alarm, draws)
    search = unweighted(estimator, model, recording)
    weights = weights_of_noise(search, draws=draws, seed=seed)
    share = 1 - np.arange(1, draws + 1) / draws
    table = xr.Dataset({"false_alarm": ("lam", share)}, coords={"lam": weights})
    return LambdaChoice(float(np.quantile(weights, 1 - false_alarm)), table, reached=True)


@checked()
def lambda_from_whiteness(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    level: Level = 0.95,
) -> LambdaChoice:
    """Weight whose forces leave nothing but noise at the least expense.

    At every weight, the forces found are fitted without the l1 norm. The weight is taken with the
    smallest sum of the squared white innovations that remain, and 2 ln n for every force, of n
    places and moments: what noise can gain by the best of so many. Then it is tested whether the
    squares have the sum that noise would have, and are not correlated in time; if not, `reached` is
    false, and the model is wrong, or the noise is not as stated.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is not used.
    model : Model
    recording : xarray.Dataset
    level : float
        Of both tests.

    Returns
    -------
    LambdaChoice
        ``table`` has ``price``, ``chi2``, ``limit`` (its quantile), ``correlation`` and
        ``correlation_limit`` (sum of squared correlations at the first lags, all sensors), and
        ``nonzeros`` over ``lam``.

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_from_whiteness(finder, rod, recording).lam > 0
    True
    """
    search = unweighted(estimator, model, recording)
    path = whole_path(search, LEAST)
    measured = int((search.filter.mask > 0).sum())
    rows, weights = [], []
    for here, after in zip(path.lam[:-1], path.lam[1:], strict=True):
        lam = float(np.sqrt(here * after))
        fit = refit(search.regression, path.at(lam)[0])
        freedom = measured - len(fit.which)
        if freedom < 1:
            break
        residual = search.regression.target - search.regression.columns[:, fit.which] @ fit.values
        weights.append(lam)
        rows.append(
            (
                fit.cost,
                scipy.stats.chi2.ppf(level, freedom),
                _colour(search, residual),
                len(fit.which),
            )
        )
    names = ("chi2", "limit", "correlation", "nonzeros")
    table = xr.Dataset(
        {n: ("lam", np.array(c)) for n, c in zip(names, zip(*rows, strict=True), strict=True)},
        coords={"lam": weights},
    )
    bound = float(scipy.stats.chi2.ppf(level, LAGS * search.filter.y.shape[1]))
    table["correlation_limit"] = ("lam", np.full(len(weights), bound))
    table["price"] = table["chi2"] + 2 * np.log(len(search.step)) * table["nonzeros"]
    best = int(np.argmin(table["price"].values))
    chosen = table.isel(lam=best)
    white = chosen["chi2"] <= chosen["limit"] and chosen["correlation"] <= bound
    return LambdaChoice(float(weights[best]), table, bool(white))


def _colour(search: ForceSearch, residual: Array) -> float:
    """Sum over sensors and lags of n times the squared correlation; chi-squared if white."""
    w = residual.reshape(search.filter.y.shape)
    power = np.maximum((w**2).sum(axis=0), np.finfo(float).tiny)
    return float(
        sum(
            (len(w) * ((w[lag:] * w[: len(w) - lag]).sum(axis=0) / power) ** 2).sum()
            for lag in range(1, min(LAGS + 1, len(w)))
        )
    )


@checked()
def lambda_from_sensors(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    points: Count = 30,
) -> LambdaChoice:
    """Largest weight with which the other sensors predict each sensor as well as with any.

    One sensor after the other is left out. Forces and states that are found from the others say
    what it should have shown; too few forces do not, and neither do forces that follow the noise.
    Some too many do little harm, so that it is the largest weight whose squared errors are not
    larger than the smallest by more than the standard error of their difference.

    This needs sensors enough that any one of them may be missing, and less trust in the stated
    noise than the other ways.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is not used.
    model : Model
    recording : xarray.Dataset
    points : int
        Weights that are compared, between a hundredth of the largest and the largest.

    Returns
    -------
    LambdaChoice
        ``table`` has ``error (lam, output)``, the root mean square error of the prediction in
        standard deviations of the sensor, and ``as_good (lam)``. `reached` is false if the best
        weight is at an end.

    Raises
    ------
    TuningError, ModelError
        As `find_sparse_forces`.
    DataError
        As `find_sparse_forces`, or if there is only one sensor.

    Examples
    --------
    >>> sensors = {"tip": ("displacement", [1.0]), "mid": ("displacement", [0.6])}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces={"hit": [1.0]})
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 2))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m", "mid": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_from_sensors(finder, rod, recording, points=3).lam > 0
    True
    """
    outputs = [s.name for s in model.outputs]
    if len(outputs) < 2:
        raise DataError("one sensor cannot predict itself; use lambda_from_noise")
    largest = 2 * np.abs(unweighted(estimator, model, recording).regression.correlation).max()
    grid = np.geomspace(largest, LEAST * largest, points)
    squares = np.array([_left_out(estimator, model, recording, name, grid) for name in outputs])
    error = np.sqrt(np.nanmean(squares, axis=2)).T
    table = xr.Dataset(
        {"error": (("lam", "output"), error)}, coords={"lam": grid, "output": outputs}
    )
    total = np.nansum(squares, axis=0)
    best = int(total.sum(axis=1).argmin())
    worse = total - total[best]
    doubt = worse.std(axis=1) / np.sqrt(worse.shape[1])
    first = int(np.argmax(worse.mean(axis=1) <= doubt))
    table["as_good"] = ("lam", worse.mean(axis=1) <= doubt)
    return LambdaChoice(float(grid[first]), table, first > 0 and best < points - 1)


def _left_out(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    name: str,
    grid: Array,
) -> Array:
    """Squared errors (weights, n) at a sensor that the others predict, in variances."""
    others = recording.copy()
    others["y"] = recording["y"].where(recording["output"] != name)
    search = unweighted(estimator, model, others)
    path = whole_path(search, LEAST)
    f, s = search.filter, search.filter.forced.system.s
    i = [output.name for output in model.outputs].index(name)
    y = recording["y"].sel(output=name).values / s.sy[i]
    scale, weight = np.sqrt(s.R[i, i]), match(model, recording, estimator=estimator)[2][:, i]
    found = []
    for lam in grid:
        fit = refit(search.regression, path.at(max(lam, path.lam[-1]))[0])
        d = search.forces(fit.which, fit.values)
        x, _ = f.smoothed(d)
        found.append((weight * (y - f.outputs(x, d)[:, i]) / scale) ** 2)
    return np.array(found)
