"""Which equation was not finite when an estimate was lost."""

import numpy as np
import xarray as xr

from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.singular import culprit
from backsight.schema import CULPRIT, Status
from backsight.types import Array

MOST_STATES = 12
"""States with which the surroundings of a point are looked at, too."""


def with_culprit(
    result: xr.Dataset, estimator: AbstractEstimator, model: Model, *, u: Array
) -> xr.Dataset:
    """Result with the attribute `schema.CULPRIT` if an equation was not finite where it failed.

    The inputs u (n, nu) are those of the samples of the result.
    """
    lost = np.flatnonzero(result.variables["status"].values & int(Status.NOT_FINITE))
    if not len(lost):
        return result
    k = int(lost[0])
    x = result["x_hat"].values
    points = [(x[i], u[j]) for i, j in ((k, k), (k - 1, k - 1), (k - 1, k)) if i >= 0]
    if k == 0:
        try:
            points.append((estimator.assumed[1].mean(model), u[0]))
        except BacksightError:
            return result
    if k and model.nx <= MOST_STATES and "x_std" in result:
        points += [(at, u[k - 1]) for at in _around(x[k - 1], result["x_std"].values[k - 1])]
    elif not k and model.nx <= MOST_STATES:
        spread = np.sqrt(np.diag(estimator.assumed[1].covariance(model)))
        points += [(at, u[0]) for at in _around(points[-1][0], spread)]
    for point, command in points:
        if np.isfinite(point).all() and (said := culprit(model, point, command)):
            return result.assign_attrs({CULPRIT: said})
    return result


def _around(x: Array, std: Array) -> list[Array]:
    """Points beside an estimate, where sigma points are."""
    size = np.sqrt(len(x)) * np.diag(np.where(np.isfinite(std), std, 0.0))
    return [x + by * row for row in size for by in (-1.0, 1.0)]
