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
    """
    without = estimator.weighted(math.inf)
    return float(estimate(without, model, recording)["lam_max"].max())
