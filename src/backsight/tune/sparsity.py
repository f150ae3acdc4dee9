"""The weight from which on no sparse force is found: the end of the scale for `lam`."""

import math

import xarray as xr

from backsight.description import checked
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.run.estimation import estimate


@checked()
def lambda_max(estimator: AbstractForceEstimator, model: Model, recording: xr.Dataset) -> float:
    r"""Smallest weight of the l1 norm with which no window of a recording contains a force.

    Without forces every window leaves the residual r with the covariance S; an atom
    :math:`\theta` enters it as soon as :math:`2 |\theta' S^{-1} r| > \lambda`.

    Parameters
    ----------
    estimator : AbstractForceEstimator
        Its `lam` is ignored.
    model : Model
    recording : xarray.Dataset

    Returns
    -------
    float
        In the unit of `CompressiveSensingMHE.lam`. Useful weights are between a ten-thousandth of
        it, where there is hardly any noise, and half of it.

    Raises
    ------
    TuningError, ModelError, DataError
        As `estimate`.

    Examples
    --------
    >>> import numpy as np
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> y = 1e-5 * np.random.default_rng(0).standard_normal((30, 1))
    >>> recording = bs.data.from_arrays(y=y, inputs={}, outputs={"tip": "m"}, dt=0.01)
    >>> noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    >>> bs.tune.lambda_max(
    ...     finder, rod, recording
    ... ) > 15.0  # so that with lam = 15 something is found
    True
    """
    without = estimator.weighted(math.inf)
    return float(estimate(without, model, recording)["lam_max"].max())
