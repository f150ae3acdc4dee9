"""Weight of the l1 norm by stability: forces must come again when the noise is another."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from backsight.description import Count, Whole, checked
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.sparse import Regression, l1_path, refit
from backsight.tune._force_path import unweighted
from backsight.tune.lambda_choice import LEAST, LambdaChoice
from backsight.types import Array


@checked()
def lambda_from_pairs(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    pairs: Count = 4,
    points: Count = 30,
    seed: Whole = 0,
) -> LambdaChoice:
    r"""Largest weight whose forces, found in one copy of the recording, explain another one.

    With the white innovations :math:`\eta = H \alpha + v` of a Kalman filter without forces, and
    noise :math:`\gamma` of the same kind that is drawn, the copies :math:`\eta + \gamma` and
    :math:`\eta - \gamma` have the same forces and independent noise of twice the variance. What the
    l1 norm finds in one, at :math:`\sqrt 2 \lambda`, is fitted there without it and predicts the
    other: forces that follow the noise do not come again. It is the largest weight whose squared
    errors are not larger than the smallest by more than the standard error of their difference.

    Halves of the measurements, the usual complementary pairs, do not work here: a hit is in few
    samples, and half of a few sensors does not tell places apart. One sensor is enough for these
    pairs, but the stated noise must be right: what there is beyond it is explained by forces.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is not used.
    model : Model
    recording : xarray.Dataset
    pairs : int
        Pairs of copies.
    points : int
        Weights that are compared, between a hundredth of the largest and the largest.
    seed : int
        Of the noise that is drawn.

    Returns
    -------
    LambdaChoice
        ``table`` has ``error (lam)``, the root mean square error of the prediction in standard
        deviations of the noise, 1.41 at best; ``again (lam)``, the share of the atoms found that
        are found in the other copy, too, at most a step earlier or later; and ``as_good (lam)``.
        `reached` is false if the best weight is at an end.

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`.

    References
    ----------
    Leiner, Duan, Wasserman, Ramdas, "Data fission: splitting a single data point", 2023, Journal of
    the American Statistical Association, doi:10.1080/01621459.2023.2270748.
    Shah, Samworth, "Variable selection with error control: another look at stability selection",
    2013, Journal of the Royal Statistical Society B 75, doi:10.1111/j.1467-9868.2011.01034.x.

    Examples
    --------
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_from_pairs(finder, rod, recording, points=5).lam > 0
    True
    """
    search = unweighted(estimator, model, recording)
    given, rng = search.regression, np.random.default_rng(seed)
    measured = search.filter.mask.ravel() > 0
    largest = 2 * float(np.abs(given.correlation).max(initial=0.0))
    grid = np.geomspace(largest, LEAST * largest, points)
    squares, again = np.zeros((points, int(measured.sum()))), np.zeros((points, 2))
    for _ in range(pairs):
        noise = np.where(measured, rng.standard_normal(measured.size), 0.0)
        copies = [Regression(given.columns, given.target + s * noise, given.side) for s in (1, -1)]
        here = [_found(copy, np.sqrt(2) * grid) for copy in copies]
        for own, other in ((0, 1), (1, 0)):
            for i, which in enumerate(here[own]):
                fit = refit(copies[own], which)
                missed = copies[other].target - given.columns[:, fit.which] @ fit.values
                squares[i] += missed[measured] ** 2 / (2 * pairs)
                moments = search.step * len(search.step) + search.atom
                near = _near(which, here[other][i], moments, len(search.step))
                again[i] += near, len(which)
    best = int(squares.sum(axis=1).argmin())
    worse = squares - squares[best]
    as_good = worse.mean(axis=1) <= worse.std(axis=1) / np.sqrt(worse.shape[1])
    first = int(np.argmax(as_good))
    table = xr.Dataset(
        {
            "error": ("lam", np.sqrt(squares.mean(axis=1))),
            "again": ("lam", again[:, 0] / np.maximum(again[:, 1], 1)),
            "as_good": ("lam", as_good),
        },
        coords={"lam": grid},
    )
    return LambdaChoice(float(grid[first]), table, first > 0 and best < points - 1)


def _found(copy: Regression, weights: Array) -> list[NDArray[np.intp]]:
    """Atoms that the l1 norm finds at falling weights."""
    path = l1_path(copy, float(weights[-1]))
    return [
        path.at(max(lam, path.lam[-1]))[0] if lam < path.lam[0] else np.zeros(0, np.intp)
        for lam in weights
    ]


def _near(
    which: NDArray[np.intp], other: NDArray[np.intp], moments: NDArray[np.intp], apart: int
) -> int:
    """How many atoms are among others, at most a step away; `moments` are steps times `apart`."""
    there = moments[other]
    return sum(bool(np.isin(moments[k] + np.array([-apart, 0, apart]), there).any()) for k in which)
