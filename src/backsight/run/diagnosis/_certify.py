"""Show on a user's own model that a window loses nothing: MHE = Kalman filter = least squares."""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from backsight.analysis.certificate import (
    Certificate,
    Claim,
    Estimates,
    LinearGaussian,
    dense_least_squares,
    draw,
    lagged,
)
from backsight.description import Positive, Whole, checked
from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import settle_steps
from backsight.engine import vm
from backsight.errors import ModelError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal, vector
from backsight.run.diagnosis._linearised import linearised, midpoint
from backsight.run.estimation import matched_inputs
from backsight.types import Array, ByName

TOLERANCE = 1e-9
"""Largest difference that counts as none, in standard deviations."""

MISSING = 0.1
"""Share of the measurements that is left out."""

OF_NOISE = {
    "sigma_u": "noise of the inputs (sigma_u)",
    "sigma_p": "noise of parameters (sigma_p)",
    "cross": "noise that process and sensors have in common (cross)",
    "outliers": "the rule for outliers",
}
"""Fields of the noise that additive Gaussian noise does not have."""

WINDOWS, LEAST, MOST = 4, 40, 200
"""Windows that are gone through, and samples at least and at most."""


@checked()
def certify(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    *,
    at: ByName | None = None,
    seed: Whole = 0,
    tolerance: Positive = TOLERANCE,
) -> Certificate:
    """Show whether an estimator equals the Kalman filter and least squares over all samples.

    The model is linearised and carried to discrete time; data are drawn from it with the
    estimator's own noise and prior and the recorded input, some measurements missing. On such data
    nothing is better than the Kalman filter, and an estimator over a window equals it exactly if
    its arrival cost is right. Limits, bounds, rules for outliers and noise that is not additive
    are taken off: they are no part of the claim, and the certificate names them.

    Parameters
    ----------
    estimator : AbstractEstimator
        With a noise and a prior. If it has a field ``arrival`` or ``arrival_weight``, others are
        tried in its place, and the certificate says for which of them the claim holds.
    model : Model
        As for the estimator.
    recording : xarray.Dataset
        Gives the inputs, and the point at which the model is linearised: the estimate of an
        extended Kalman filter in the middle.
    at : dict, sequence or number, optional
        That point by hand; states that a dict leaves out take their value in the model.
    seed : int
        Of the data.
    tolerance : float
        Largest difference of estimates that counts as none, in standard deviations; covariances
        are allowed to lose some digits more, see `backsight.analysis.certificate.certificate.LOST`.

    Returns
    -------
    Certificate
        Prints itself as a table; ``holds`` if the estimator as it is equals both.

    Raises
    ------
    TuningError, ModelError
        If estimator and model do not fit, or the estimator has no noise and prior.
    DataError
        If recording and model do not fit.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 30, dt=0.05, sigma_y=1e-3, seed=1)
    >>> ekf = bs.EKF(bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=0.1))
    >>> bs.check.certify(ekf, spring, recording).holds
    True
    """
    noise, prior = estimator.assumed
    dt = float(recording.attrs["dt"])
    u = matched_inputs(model, recording)
    point, middle = _point(estimator, model, recording, at)
    given = estimator.integration or Integrator()
    integrator = settle_steps(given, model, lambda: estimator.modes(model), dt=dt)
    A, B, C, D = linearised(model, point, u[middle], dt=dt, integrator=integrator)
    system = LinearGaussian(
        *(A, B, C, D),
        Q=noise.process(model) + _driven(noise, model, point, u[middle], dt),
        R=noise.measurement(model),
        P0=prior.covariance(model),
    )
    N, lag = estimator.horizon, estimator.delay
    samples = min(max(WINDOWS * (N + 1), LEAST), MOST)
    inputs = u[(middle + np.arange(samples)) % len(u)] - u[middle]
    y = draw(system, inputs, missing=MISSING, seed=seed)
    best, full = lagged(system, inputs, y, lag), dense_least_squares(system, inputs, y)
    plain = _plain(model, system, dt)
    claims = []
    for name, variant in estimator.variants().items():
        try:
            found = _run(_on(variant, system), plain, dt, inputs, y)
        except (TuningError, ModelError):
            if variant is estimator:
                raise
            claims.append(Claim(name, False, *[math.inf] * 4))
            continue
        claims.append(
            Claim(
                name=name,
                own=variant is estimator,
                x=_off(found.x, best.x, best.P),
                P=_off_covariance(found.P, best.P),
                x_full=_off(found.x[-1:], full.x[[-1 - lag]], best.P[-1:]),
                P_full=_off_covariance(found.P[-1:], full.P[[-1 - lag]]),
            )
        )
    return Certificate(
        estimator=estimator.title,
        claims=tuple(claims),
        references=_off(best.x[-1:], full.x[[-1 - lag]], best.P[-1:]),
        samples=samples,
        missing=MISSING,
        seed=seed,
        lag=lag,
        at={s.name: float(v) for s, v in zip(model.states, point, strict=True)},
        tolerance=tolerance,
        left_out=tuple(_left_out(estimator, model)),
        rounding=_last_digit(best.x, best.P),
    )


def _last_digit(x: Array, P: Array) -> float:
    """Largest rounding of estimates (n, nx), in their standard deviations; 0 where these are."""
    deviations = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0))
    known = deviations > 0
    return float((np.spacing(np.abs(x[known])) / deviations[known]).max(initial=0.0))


def _point(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset, at: ByName | None
) -> tuple[Array, int]:
    if at is None:
        return midpoint(estimator, model, recording)
    values = np.array([s.value for s in model.states])
    return vector(at, model.states, what="at", default=values), recording.sizes["time"] // 2


def _driven(noise: Noise, model: Model, x: Array, u: Array, dt: float) -> Array:
    """What the spectral density of the noise adds in a sampling period, (nx, nx)."""
    density = noise.density(model)
    if not density.any():
        return density
    symbols = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rates = ca.densify(ca.jacobian(model.rhs(*symbols), symbols[0]))
    return discretise_noise(np.array(ca.Function("A", symbols, [rates])(x, u)), density, dt=dt)[1]


def _plain(model: Model, system: LinearGaussian, dt: float) -> Model:
    """Build the linear model of deviations, with the scales but not the bounds of the model."""
    states = {s.name: Signal(s.unit, scale=s.scale) for s in model.states}
    inputs = {s.name: Signal(s.unit, scale=s.scale) for s in model.inputs}
    outputs = {s.name: Signal(s.unit, scale=s.scale) for s in model.outputs}
    matrices = (system.A, system.B, system.C, system.D)
    return lti(*matrices, states=states, inputs=inputs, outputs=outputs, dt=dt, name=model.name)


def _on(estimator: AbstractEstimator, system: LinearGaussian) -> AbstractEstimator:
    """Prepare an estimator for the linear model: its noise, no limits, a discrete model's steps."""
    prior = Prior(P0=system.P0, x0=np.zeros(len(system.A)))
    changes: dict[str, Any] = {"noise": Noise(R=system.R, Q=system.Q), "prior": prior}
    free = {"limits": (), "soft": {}, "hold": "zoh", "integrator": Integrator()}
    fields = {f.name for f in dataclasses.fields(estimator)}
    return dataclasses.replace(
        estimator, **changes, **{k: v for k, v in free.items() if k in fields}
    )


def _left_out(estimator: AbstractEstimator, model: Model) -> Iterator[str]:
    """What `_on` and `_plain` take off, by name."""
    noise, _ = estimator.assumed
    yield from (text for name, text in OF_NOISE.items() if getattr(noise, name) is not None)
    yield from estimator.restrictions
    bounded = [s.name for s in model.states if np.isfinite([s.lower, s.upper]).any()]
    if bounded:
        yield f"the bounds of {', '.join(bounded)}"
    if estimator.input_hold == "foh":
        yield "inputs interpolated between the samples (foh)"


def _run(estimator: AbstractEstimator, model: Model, dt: float, u: Array, y: Array) -> Estimates:
    recursion = estimator.compile(model, dt)
    seen = np.isfinite(y)
    data = [u, np.where(seen, y, 0.0), seen.astype(float)]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    named = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    return Estimates(named["x_hat"], named["P"])


def _off(x: Array, reference: Array, P: Array) -> float:
    deviation = _deviations(P)
    with np.errstate(invalid="ignore"):
        return _largest(np.abs(x - reference) / deviation)


def _off_covariance(P: Array, reference: Array) -> float:
    deviation = _deviations(reference)
    return _largest(np.abs(P - reference) / (deviation[:, :, None] * deviation[:, None, :]))


def _deviations(P: Array) -> Array:
    """Standard deviations (n, nx); of a state that is known exactly, the largest it ever has."""
    std = np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    largest = std.max(axis=0)
    floor = np.where(largest > 0, 1e-6 * largest, 1.0)
    return np.maximum(std, floor)


def _largest(values: Array) -> float:
    return float(np.max(np.where(np.isfinite(values), values, np.inf)))
