"""Which equation was not finite when an estimate was lost."""

import numpy as np
import xarray as xr

from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.singular import culprit
from backsight.schema import CULPRIT, Status
from backsight.types import Array


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
    for point, command in points:
        if np.isfinite(point).all() and (said := culprit(model, point, command)):
            return result.assign_attrs({CULPRIT: said})
    return result
