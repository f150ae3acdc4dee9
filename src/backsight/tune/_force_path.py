"""Sparse forces as functions of the weight of the l1 norm: the whole path at once."""

import numpy as np
import xarray as xr

from backsight.description import Level, checked
from backsight.errors import DataError, TuningError
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.sparse_forces import prepared
from backsight.sparse import ForceSearch, L1Path, l1_path
from backsight.types import Array

ANY = 1.0
"""A weight for estimators whose own is not used."""


@checked()
def trace_force_path(
    estimator: AbstractForceEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    least: Level = 0.01,
) -> xr.Dataset:
    r"""Forces for all weights of the l1 norm, over a whole recording.

    The solution is piecewise linear in :math:`\lambda`: it is known everywhere from its kinks, and
    these are exact (homotopy). Forces that stay over a long stretch of weights are there; what
    comes and goes is noise.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        As for `find_sparse_forces`; its `lam` is not used.
    model : Model
    recording : xarray.Dataset
    least : float
        Where the path ends, as a share of the weight from which on nothing is found.

    Returns
    -------
    xarray.Dataset
        ``alpha (lam, atom)``, the factor of every atom that is found anywhere, at the kinks,
        falling in ``lam``; ``nonzeros (lam)``; ``chi2 (lam)``, the sum of the squared white
        innovations that remain. Coordinates of an atom: ``moment`` [s] at which it begins, and
        ``place``. Attributes: ``measured``, the number of measurements; ``kkt``, the violation of
        the optimality conditions at the end as a share of the weight.

    Raises
    ------
    TuningError, ModelError, DataError
        As `find_sparse_forces`; if `least` is not between 0 and 1; or if the recording is at rest.

    Examples
    --------
    >>> import numpy as np
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> sorted(bs.tune.trace_force_path(finder, rod, recording, least=0.5).data_vars)
    ['alpha', 'chi2', 'nonzeros']
    """
    search = unweighted(estimator, model, recording)
    path = whole_path(search, least)
    columns, target = search.regression.columns[:, path.which], search.regression.target
    residual = target[:, None] - columns @ path.values.T
    moments = recording["time"].values[search.step[path.which]]
    return xr.Dataset(
        {
            "alpha": (("lam", "atom"), path.values),
            "nonzeros": ("lam", (path.values != 0).sum(axis=1)),
            "chi2": ("lam", (residual**2).sum(axis=0)),
        },
        coords={
            "lam": path.lam,
            "moment": ("atom", moments, {"units": "s"}),
            "place": ("atom", places(estimator)[search.atom[path.which]]),
        },
        attrs={
            "measured": int((search.filter.mask > 0).sum()),
            "kkt": path.kkt,
            "model": model.name,
        },
    )


def unweighted(
    estimator: AbstractForceEstimator, model: Model, recording: xr.Dataset
) -> ForceSearch:
    """See `prepared`; whatever the estimator's weight and threshold are."""
    plain = estimator.weighted(ANY)
    return prepared(plain, model, recording)


def check_draws(false_alarm: float, draws: int) -> None:
    """Raise `TuningError` unless it is a probability, and the draws are enough for it."""
    if not (0 < false_alarm < 1 and draws >= 1 / false_alarm):
        raise TuningError(
            f"false_alarm = {false_alarm}, draws = {draws}: a probability, and draws "
            "enough for one to be expected"
        )


def weights_of_noise(search: ForceSearch, *, draws: int, seed: int) -> Array:
    """Weights, ascending, from which on recordings of noise alone make no force, (draws,)."""
    measured = search.filter.mask.ravel() > 0
    noise = np.random.default_rng(seed).standard_normal((draws, int(measured.sum())))
    reach = noise @ search.regression.columns[measured]
    side = search.regression.side
    reach = np.maximum(np.where(side >= 0, reach, 0.0), np.where(side <= 0, -reach, 0.0))
    return 2 * np.sort(reach.max(axis=1))


def whole_path(search: ForceSearch, least: float) -> L1Path:
    """Path down to a share of its largest weight; raises `DataError` if nothing moves."""
    if not 0 < least < 1:
        raise TuningError(f"least is {least}; it is a share of the largest weight, from 0 to 1")
    largest = 2 * float(np.abs(search.regression.correlation).max(initial=0.0))
    if not largest > 0:
        raise DataError("the recording is exactly what the model does without forces: none acts")
    return l1_path(search.regression, least * largest)


def places(estimator: AbstractForceEstimator) -> Array:
    """Name of the force that every atom moves; ``atom 3`` where it moves several."""
    belongs = estimator.dictionary.force_of(len(estimator.forces))
    return np.array([estimator.forces[f] if f >= 0 else f"atom {i}" for i, f in enumerate(belongs)])
