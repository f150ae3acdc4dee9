"""Say with a result how the model was carried from sample to sample, and whether that sufficed."""

import numpy as np
import xarray as xr

from backsight.discrete.modes import modes_at
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import complaint, in_words
from backsight.models.model import Model
from backsight.schema import COARSE, INTEGRATION, Status
from backsight.types import Array

POINTS, FEW = 50, 5
"""Samples along the estimates at which the modes are looked at, and of a model with many states."""

MANY = 60
"""States from which on they are few."""


def with_integration(
    result: xr.Dataset, chosen: Integrator | None, model: Model, *, u: Array, dt: float
) -> xr.Dataset:
    """Result with the integrator as an attribute.

    If it was too coarse for the modes of the model along the estimates, all samples say so in their
    status, and an attribute says for which mode and what would do.

    Parameters
    ----------
    result : xarray.Dataset
    chosen : Integrator, optional
        None if the estimator or the model needs none.
    model : Model
    u : (n, nu) array
        Inputs of the samples of the result.
    dt : float
        Period of the estimator [s].
    """
    if chosen is None:
        return result
    result.attrs[INTEGRATION] = in_words(chosen)
    x = result.variables["x_hat"].values
    lost = (result.variables["status"].values & int(Status.NOT_FINITE)).any()
    finite = np.flatnonzero(np.isfinite(x).all(axis=1)) if lost else np.arange(len(x))
    count = FEW if model.nx > MANY else POINTS
    rows = finite[np.linspace(0, len(finite) - 1, min(count, len(finite))).astype(int)]
    if not len(rows):
        return result
    coarse = complaint(chosen, lambda: modes_at(model, x[rows], u[rows]), dt=dt)
    if not coarse:
        return result
    raised = result["status"] | int(Status.COARSE_STEP)
    status = raised.astype(np.int32).assign_attrs(result["status"].attrs)
    return result.assign(status=status).assign_attrs({COARSE: coarse})
