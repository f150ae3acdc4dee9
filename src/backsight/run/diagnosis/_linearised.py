"""A model from sample to sample in the surroundings of a point."""

import dataclasses

import casadi as ca
import numpy as np
import xarray as xr

from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import over_sample
from backsight.errors import EstimationError, ModelError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import estimate
from backsight.types import Array

LONGEST = 4000
"""Samples that an extended Kalman filter needs at most to come near the truth."""


def linearised(
    model: Model, x: Array, u: Array, *, dt: float, integrator: Integrator
) -> tuple[Array, Array, Array, Array]:
    """A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu) of deviations from x (nx,) and u (nu,).

    Inputs are held between the samples.

    Raises
    ------
    ModelError
        If an entry is not finite.
    """
    symbols = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    y = model.output(*symbols)
    entries = [ca.densify(ca.jacobian(y, by)) for by in symbols]
    C, D = (np.array(m) for m in ca.Function("matrices", symbols, entries).call([x, u]))
    held = dataclasses.replace(integrator, hold="zoh")
    _, A, B = (np.array(m) for m in over_sample(held, model, dt).call([x, u, u]))
    if not all(np.isfinite(m).all() for m in (A, B, C, D)):
        raise ModelError(f"model '{model.name}' has no derivative at the point; choose another")
    return A, B, C, D


def midpoint(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset
) -> tuple[Array, int]:
    """Estimate (nx,) of an extended Kalman filter in the middle of a recording, and the sample."""
    k = min(recording.sizes["time"] // 2, LONGEST)
    part = recording.isel(time=slice(0, k + 1))
    try:
        result = estimate(yardstick(estimator, model), model, part)
    except EstimationError as error:
        raise ModelError(
            f"the extended Kalman filter diverged before the middle of the recording; give the "
            f"point with `at`: {error}"
        ) from None
    return result["x_hat"].values[-1], k
