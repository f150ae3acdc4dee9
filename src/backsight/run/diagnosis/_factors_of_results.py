"""By how much R and Q of a result are wrong: its filter linearised along the recording."""

import dataclasses

import casadi as ca
import numpy as np
import xarray as xr

from backsight.analysis.consistency import (
    NOISE_FACTORS,
    FilterPath,
    NoiseFactors,
    filter_gains,
    noise_factors,
)
from backsight.analysis.outliers import taken, weighed
from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import over_sample, settle_steps
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise
from backsight.models.lti import state_equation
from backsight.models.model import Model
from backsight.schema import SIGMA_FACTOR

LEAST, MOST = 600, 4000
"""Measured samples that say something, and those that suffice: the last ones are taken."""

LONGEST = 1_000_000
"""Entries of the transition matrices between them at most."""

MOST_STATES = 20
"""A model with more states takes too long for a question that is asked after every run."""

WIDER = 1.1
"""By how much the variance of an innovation may exceed the usual one where all is settled."""

SAME = 0.05
"""Deviation from the update of a Kalman filter, per innovation, that linearisation may cause."""


def with_factors(result: xr.Dataset, found: NoiseFactors | None) -> xr.Dataset:
    """Result with the `NoiseFactors` as an attribute, if there are any."""
    if found is None:
        return result
    return result.assign_attrs({NOISE_FACTORS: [float(v) for v in dataclasses.astuple(found)]})


def factors_of(
    result: xr.Dataset, estimator: AbstractEstimator, model: Model
) -> NoiseFactors | None:
    """Find by how much the noise of an estimator is wrong.

    Parameters
    ----------
    result : xarray.Dataset
        Of this estimator and model.
    estimator : AbstractEstimator
    model : Model

    Returns
    -------
    NoiseFactors or None
        None if that cannot be said: too few samples (the start, in which the estimates settle, does
        not count, see `_settled`), too many states, samples with a noise of their own, or an
        estimator that does not correct like a Kalman filter, so that the theory does not hold.
    """
    try:
        noise, _ = estimator.assumed
    except TuningError:
        return None
    if model.nx > MOST_STATES or SIGMA_FACTOR in result:
        return None
    if weighed(result) or noise.beyond_additive:
        return None
    measured = np.flatnonzero(taken(result).any("output").values)
    earliest = max(_settled(result), result.sizes["time"] - LONGEST // model.nx**2)
    measured = measured[measured >= earliest][-MOST:]
    if len(measured) < LEAST:
        return None
    last = result.isel(time=slice(int(measured[0]), None))
    path = _path(last, estimator, model, noise)
    usable = all(np.isfinite(v).all() for v in (path.F, path.H, path.P, path.S))
    variance = np.einsum("kii->ki", path.S)
    if not usable or (variance <= 0).any() or not np.isfinite(path.e).any(axis=0).all():
        return None
    return noise_factors(path) if _kalman(path, last) else None


def _settled(result: xr.Dataset) -> int:
    """The sample from which on innovations are known as well as in the second half, about.

    What is learned at the start, parameters above all, then adds nothing any more to what is
    expected of a measurement. A tenth is left out in any case, and half at most.
    """
    n = result.sizes["time"]
    variance = np.einsum("kii->ki", result["S"].values)
    usual = np.median(variance[n // 2 :], axis=0)
    unsettled = np.flatnonzero((variance > WIDER * usual).any(axis=1))
    return min(max(int(unsettled.max(initial=-1)) + 1, n // 10), n // 2)


def _path(
    result: xr.Dataset, estimator: AbstractEstimator, model: Model, noise: Noise
) -> FilterPath:
    dt = float(result.attrs["dt"])
    u, x = result["u"].values, result["x_hat"].values
    ahead = np.vstack([u[1:], u[-1:]])
    n, nx, ny = len(x), model.nx, model.ny
    chosen = _integrator(estimator, model, dt)
    derivatives = _derivatives(model, dt, chosen).map(n)
    F, H = (np.array(v) for v in derivatives.call([x.T, u.T, ahead.T]))
    F, H = F.reshape(nx, n, nx).transpose(1, 0, 2), H.reshape(ny, n, nx).transpose(1, 0, 2)
    Qc = noise.density(model)
    added = np.broadcast_to(noise.process(model), F.shape)
    linear = state_equation(model) if Qc.any() else None
    if linear is not None:
        added = added + discretise_noise(linear[0], Qc, dt=dt)[1]
    elif Qc.any():
        # The noise acts during the sample: half of it before and half after the transition.
        added = added + 0.5 * dt * (F @ Qc @ F.transpose(0, 2, 1) + Qc)
    return FilterPath(
        F=F,
        H=H,
        P=result["P"].values,
        e=np.where(taken(result).values, result["e"].values, np.nan),
        S=result["S"].values,
        Q=added,
        R=noise.measurement(model),
    )


def _integrator(estimator: AbstractEstimator, model: Model, dt: float) -> Integrator:
    given = estimator.integration or Integrator(hold=estimator.input_hold)
    return settle_steps(given, model, lambda: estimator.modes(model), dt=dt)


def _derivatives(model: Model, dt: float, integrator: Integrator) -> ca.Function:
    """``(x, u, u_next) -> (F, H)``."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    slope = ca.Function("H", [x, u], [ca.densify(ca.jacobian(model.output(x, u), x))])
    x, u, v = (ca.MX.sym(n, k) for n, k in (("x", model.nx), ("u", model.nu), ("v", model.nu)))
    _, F, _ = over_sample(integrator, model, dt)(x, u, v)
    return ca.Function("derivatives", [x, u, v], [F, slope(x, u)])


def _kalman(path: FilterPath, result: xr.Dataset) -> bool:
    """Whether the outputs after the measurement are those of a Kalman filter's gain."""
    e = np.nan_to_num(path.e)
    corrected = e - np.einsum("kij,kj->ki", path.H @ filter_gains(path), e)
    off = np.abs((result["y"] - result["y_hat"]).values - corrected)
    size = np.nanmedian(np.abs(path.e), axis=0)
    return bool((np.nanmedian(off, axis=0) <= SAME * size).all())
