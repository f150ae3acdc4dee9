"""Linear models from sample to sample: what the estimators of the linear family work with."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.analysis.observability import check_observability
from backsight.discrete.exact import foh, zoh
from backsight.discrete.noise import integrated_noise
from backsight.discrete.runge_kutta import Hold, Integrator
from backsight.discrete.steps import over_sample
from backsight.discrete.varying import transitions
from backsight.errors import ModelError, TuningError
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import bent, coefficients, lti, state_space
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Linear:
    r"""A scaled linear model with its noise, from sample to sample.

    .. math:: x_{k+1} = A x_k + B u_k + B_1 u_{k+1} + w_k, \qquad y_k = C x_k + D u_k + v_k

    Parameters
    ----------
    s : Setting
        Of the model without :math:`B_1`, in discrete time; `Setting.Q` is the covariance of w.
    A, B, B_next, C, D : arrays
        Scaled. `B_next` is zero unless the input is interpolated.
    ramp : bool
        Whether the input is interpolated.
    """

    s: Setting
    A: Array
    B: Array
    B_next: Array
    C: Array
    D: Array
    ramp: bool


@dataclasses.dataclass(frozen=True)
class Varying:
    r"""A scaled model that is linear in its states, with coefficients that known inputs change.

    .. math:: x_{k+1} = A_k x_k + b_k + w_k, \qquad y_k = C(u_k) x_k + d(u_k) + v_k

    Parameters
    ----------
    s : Setting
        Of the model itself, in its own time; `Setting.Q` is what is added per sample.
    transitions : casadi.Function
        ``(u, u_next) -> (A, b, Q)``, scaled; Q is all of the covariance of w.
    ramp : bool
        Whether the input is interpolated.
    """

    s: Setting
    transitions: ca.Function
    ramp: bool

    @property
    def at_rest(self) -> tuple[Array, Array]:
        """A (nx, nx) and C (ny, nx) without inputs."""
        still = np.zeros(self.s.model.nu)
        A, C = self.transitions(still, still)[0], coefficients(self.s.model, outputs=True)(still)[0]
        return np.asarray(A), np.asarray(C)


def in_time(
    model: Model,
    dt: float,
    *,
    noise: Noise,
    prior: Prior,
    hold: Hold,
    noiseless: bool = False,
) -> Linear | Varying:
    """Carry a model that is linear in its states exactly to discrete time.

    As `linear` does; coefficients may change with the inputs.

    Raises
    ------
    TuningError, ModelError
        If anything does not fit, above all if the model is not linear in its states.
    """
    try:
        state_space(model)
    except ModelError as error:
        if found := bent(model):
            bends = "; ".join(f"{label} is nonlinear" for label in found)
            raise ModelError(
                f"model '{model.name}' is not linear: {bends}; use an estimator for nonlinear "
                "models, such as EKF"
            ) from error
    else:
        return linear(model, dt, noise=noise, prior=prior, hold=hold, noiseless=noiseless)
    _check_hold(model, hold)
    s = setting(model, dt, noise=noise, prior=prior)
    steps = transitions(s.model, s.Qc, dt=dt, ramp=hold == "foh")
    u, v = ca.MX.sym("u", model.nu), ca.MX.sym("u_next", model.nu)
    A, b, Q = steps(u, v)
    whole = ca.Function("transitions", [u, v], [A, b, Q + ca.MX(ca.DM(s.Q))])
    return Varying(s, whole, hold == "foh")


def linear(
    model: Model,
    dt: float,
    *,
    noise: Noise,
    prior: Prior,
    hold: Hold,
    noiseless: bool = False,
) -> Linear:
    """Check a description against the model, scale it, and carry it exactly to discrete time.

    A continuous model is discretised by matrix exponentials, the density of its noise by Van
    Loan's integral.

    Raises
    ------
    TuningError, ModelError
        If anything does not fit, above all if the model is not linear.
    """
    _check_hold(model, hold)
    try:
        state_space(model)
    except ModelError as error:
        others = "" if bent(model) else "KalmanFilter, LinearMHE (coefficients may change) or "
        raise ModelError(
            f"{error}; use {others}an estimator for nonlinear models, such as EKF"
        ) from None
    s = setting(model, dt, noise=noise, prior=prior, noiseless=noiseless)
    A, B, C, D = state_space(s.model)
    B_next = np.zeros_like(B)
    if model.continuous:
        rates = A
        s = s.with_noise(lambda Q, Qc: (Q + integrated_noise(rates, Qc, dt=dt)[1], 0 * Qc))
        if hold == "foh":
            A, B, B_next = foh(A, B, dt=dt)
        else:
            A, B = zoh(A, B, dt=dt)
    m = s.model
    sampled = lti(
        A, B, C, D, states=m.states, inputs=m.inputs, outputs=m.outputs, dt=dt, name=m.name
    )
    s = dataclasses.replace(s, model=sampled)
    return Linear(s, A, B, B_next, C, D, hold == "foh")


def at_mean(model: Model, dt: float, *, noise: Noise, prior: Prior) -> Linear:
    """Carry any model to discrete time at the prior's mean, without inputs.

    The setting has the nonlinear model, its integrator, and all process noise per sample.

    Raises
    ------
    TuningError
        If the description does not fit, or the model has no slope there.
    """
    given = setting(model, dt, noise=noise, prior=prior, integrator=Integrator())
    s, still = given.sampled(), np.zeros(model.nu)
    _, A, B = (np.array(m) for m in over_sample(s.integrator, s.model, dt)(s.x0, still, still))
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    slopes = [ca.densify(ca.jacobian(s.model.output(x, u), z)) for z in (x, u)]
    C, D = (np.array(m) for m in ca.Function("slopes", [x, u], slopes)(s.x0, still))
    if not all(np.isfinite(m).all() for m in (A, B, C, D)):
        raise TuningError(f"model '{model.name}' has no slope at the prior's mean; move the prior")
    return Linear(s, A, B, np.zeros_like(B), C, D, ramp=False)


def _check_hold(model: Model, hold: Hold) -> None:
    if hold == "foh" and not model.continuous:
        raise TuningError("hold 'foh' needs a continuous-time model; use 'zoh'")


def without_bounds(s: Setting) -> Setting:
    """Return the setting of the same model without bounds on its states."""
    free = [dataclasses.replace(x, lower=-np.inf, upper=np.inf) for x in s.model.states]
    return dataclasses.replace(s, model=dataclasses.replace(s.model, states=tuple(free)))


def require_observable(model: Model, *, samples: int | None = None) -> None:
    """Raise `TuningError` unless the outputs see all states, and within so many samples."""
    found = check_observability(model)
    if found.hidden:
        raise TuningError(
            f"the outputs of model '{model.name}' do not see {'; '.join(found.hidden)}; add a "
            "sensor, or use KalmanFilter, which lets such states be as the prior says"
        )
    if samples is not None and samples < found.samples:
        raise TuningError(
            f"the window holds {samples} measured samples, fewer than the observability index "
            f"{found.samples}, and does not determine the states; lengthen the horizon N"
        )


def unstable(A: Array) -> bool:
    """Whether a motion x+ = A x grows."""
    return bool(np.abs(np.linalg.eigvals(A)).max(initial=0.0) > 1 + 1e-9)


def root(Q: Array) -> Array:
    """G (n, q) with G G' = Q and as many columns as Q has rank."""
    values, vectors = np.linalg.eigh(Q)
    keep = values > max(1e-14, len(Q) * np.finfo(float).eps) * max(values[-1], 0.0)
    return vectors[:, keep] * np.sqrt(values[keep])
