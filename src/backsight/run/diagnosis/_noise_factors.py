"""By how much R and Q of a result are wrong: its filter linearised along the recording."""

import casadi as ca
import numpy as np
import xarray as xr

from backsight.analysis.consistency import NOISE_FACTORS, NoiseFactors, Path, gains, noise_factors
from backsight.analysis.outliers import taken, weighed
from backsight.discrete.runge_kutta import Integrator
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise
from backsight.models.model import Model
from backsight.schema import SIGMA_FACTOR

LEAST, MOST = 500, 4000
"""Samples that say something, and samples that suffice: the last ones are taken."""

MOST_STATES = 20
"""A model with more states takes too long for a question that is asked after every run."""

SAME = 0.05
"""Deviation from the update of a Kalman filter, per innovation, that linearisation may cause."""


def with_noise_factors(
    result: xr.Dataset, estimator: AbstractEstimator, model: Model
) -> xr.Dataset:
    """Result with the `NoiseFactors` as an attribute, if it has any; see `factors_of`."""
    found = factors_of(result, estimator, model)
    if found is None:
        return result
    values = [found.R, found.R_std, found.Q, found.Q_std, found.unexplained]
    return result.assign_attrs({NOISE_FACTORS: values})


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
        not count), too many states, samples with a noise of their own, or an estimator that does
        not correct like a Kalman filter, so that the theory does not hold.
    """
    try:
        noise, _ = estimator.assumed
    except TuningError:
        return None
    settled = min(MOST, result.sizes["time"] // 2)
    if settled < LEAST or model.nx > MOST_STATES:
        return None
    if SIGMA_FACTOR in result or weighed(result) or noise.beyond_additive:
        return None
    last = result.isel(time=slice(-settled, None))
    path = _path(last, estimator, model, noise)
    usable = all(np.isfinite(v).all() for v in (path.F, path.H, path.P, path.S))
    variance = np.einsum("kii->ki", path.S)
    if not usable or (variance <= 0).any() or not np.isfinite(path.e).any(axis=0).all():
        return None
    return noise_factors(path) if _kalman(path, last) else None


def _path(result: xr.Dataset, estimator: AbstractEstimator, model: Model, noise: Noise) -> Path:
    dt = float(result.attrs["dt"])
    u, x = result["u"].values, result["x_hat"].values
    ahead = np.vstack([u[1:], u[-1:]])
    n, nx, ny = len(x), model.nx, model.ny
    derivatives = _derivatives(model, dt, _integrator(estimator)).map(n)
    F, H = (np.array(v) for v in derivatives.call([x.T, u.T, ahead.T]))
    F, H = F.reshape(nx, n, nx).transpose(1, 0, 2), H.reshape(ny, n, nx).transpose(1, 0, 2)
    Q = noise.process(model, dt)
    if model.continuous:
        # The noise acts during the sample: half of it before and half after the transition.
        added = 0.5 * dt * (F @ Q @ F.transpose(0, 2, 1) + Q)
    else:
        added = np.broadcast_to(Q, F.shape)
    return Path(
        F=F,
        H=H,
        P=result["P"].values,
        e=np.where(taken(result).values, result["e"].values, np.nan),
        S=result["S"].values,
        Q=added,
        R=noise.measurement(model),
    )


def _integrator(estimator: AbstractEstimator) -> Integrator:
    return estimator.integration or Integrator(substeps=4, hold=estimator.input_hold)


def _derivatives(model: Model, dt: float, integrator: Integrator) -> ca.Function:
    """``(x, u, u_next) -> (F, H)``."""
    x, u, v = (ca.SX.sym(n, k) for n, k in (("x", model.nx), ("u", model.nu), ("v", model.nu)))
    F, n = ca.SX.eye(model.nx), integrator.substeps
    z = ca.SX.sym("z", model.nx)
    end, ua, ub = x, ca.SX.sym("ua", model.nu), ca.SX.sym("ub", model.nu)
    if model.continuous:
        moved = integrator.substep(model.rhs, z, ua=ua, ub=ub, h=dt / n)
    else:
        moved, n = model.rhs(z, ua), 1
    # One sub-step is differentiated once; the chain rule joins them.
    step = ca.Function("substep", [z, ua, ub], [moved, ca.densify(ca.jacobian(moved, z))])
    for i in range(n):
        a, b = u + i / n * (v - u), u + (i + 1) / n * (v - u)
        end, Phi = step(end, *((u, u) if integrator.hold == "zoh" else (a, b)))
        F = Phi @ F
    H = ca.densify(ca.jacobian(model.output(x, u), x))
    return ca.Function("derivatives", [x, u, v], [ca.densify(F), H])


def _kalman(path: Path, result: xr.Dataset) -> bool:
    """Whether the outputs after the measurement are those of a Kalman filter's gain."""
    e = np.nan_to_num(path.e)
    corrected = e - np.einsum("kij,kj->ki", path.H @ gains(path), e)
    off = np.abs((result["y"] - result["y_hat"]).values - corrected)
    size = np.nanmedian(np.abs(path.e), axis=0)
    return bool((np.nanmedian(off, axis=0) <= SAME * size).all())
