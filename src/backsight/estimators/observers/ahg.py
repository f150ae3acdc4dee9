"""Adaptive high-gain observer with fixed or adaptive gain."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from backsight.description import Positive, Sound
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.adaptive_observer import AbstractAdaptiveObserver
from backsight.estimators.observers._excitation import Excitation
from backsight.estimators.observers._formulas import Interpolation, ObserverGains, Spread
from backsight.estimators.observers._high_gain import AbstractHighGain
from backsight.estimators.observers._recursion import Plan, assemble_observer
from backsight.estimators.observers._states import States, chain_start, state_bounds
from backsight.estimators.observers.adaptive_gain import AdaptiveGain, window_innovation
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.canonical.affine import AffineForm
from backsight.models.canonical.observer_form import gain_vector, moving_first, observer_form
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class AHG(AbstractHighGain, AbstractAdaptiveObserver):
    r"""Adaptive high-gain observer: states and parameters without a covariance in the loop.

    For models that are affine in combinations theta of their parameters, in the states or in the
    output and its derivatives (`observer_form` finds both), eq. 10 in its consistent form:

    .. math::
        \dot{\hat x} &= A_0 \hat x + \phi + \psi \hat\theta
            + \Lambda^{-1} (\lambda k_0 + \Upsilon \Gamma \Upsilon' c_0') (y - c_0 \hat x)

        \dot{\hat\theta} &= \lambda^n \Gamma \Upsilon' c_0' (y - c_0 \hat x)

        \dot\Upsilon &= \lambda (A_0 - k_0 c_0) \Upsilon + \lambda \psi

    The measurement is interpolated between samples, with the model's prediction for the curve:
    holding it would delay it by half a sample, which biases damping by far more than the noise.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    gain : float
        Gain lambda [1/s]; lambda_max if it adapts.
    Gamma : (p, p) array or p numbers
        Speed of adaptation per combination, in the order of `observer_form(model).combinations`.
    poles : number or n numbers
        Eigenvalues of A0 - k0 c0.
    form : {"consistent", "printed"}
        The printed eq. 10 has a surplus lambda at Upsilon Gamma Upsilon', which makes adaptation
        slower by one to two orders of magnitude.
    adaptive : AdaptiveGain, optional
        Of a gain that comes down from `gain` while the innovation is small.
    excitation : Excitation
        Window in which the excitation of the parameters is watched.
    integrator : Integrator
        `hold` is that of the input.
    interpolation : {"model", "linear", "hold"}
        The measurement between samples: along the prediction of the model, by straight lines,
        or held, which delays it by half a sampling period.

    Notes
    -----
    Noise and prior do not change the estimate. They give its covariance, that of the linearised
    error under measurement noise, random walks and an uncertain start. Parameters outside their
    bounds are set to them. Beside the usual outputs a result has ``lam`` and ``excitation``.

    References
    ----------
    Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter estimation: a
    comparison to extended and unscented Kalman filter". Besançon (ed.), "Nonlinear Observers and
    Applications", Springer 2007.

    Examples
    --------
    >>> import numpy as np
    >>> noise, prior = bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=1.0)
    >>> ahg = bs.AHG(noise, prior, gain=50.0, Gamma=np.diag([1e3, 1.0]))
    >>> ahg.gain, ahg.form
    (50.0, 'consistent')
    """

    key: ClassVar[str] = "ahg"
    title: ClassVar[str] = "Adaptive high-gain observer"
    multiplied_settings: ClassVar[tuple[str, ...]] = ("Gamma",)

    noise: Noise
    prior: Prior
    gain: Positive
    Gamma: Array
    poles: complex | tuple[complex, ...] = -1.0
    form: Literal["consistent", "printed"] = "consistent"
    adaptive: AdaptiveGain | None = None
    excitation: Excitation = dataclasses.field(default_factory=Excitation)
    integrator: Integrator = dataclasses.field(default_factory=lambda: Integrator("rk4"))
    interpolation: Interpolation = "model"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if self.adaptive and sound("adaptive", "gain") and not self.adaptive.lower < self.gain:
            yield (
                f"adaptive gain: lower = {self.adaptive.lower:g} must be below gain = {self.gain:g}"
            )

    def fixed(self) -> "AHG":
        """See `AbstractAdaptiveObserver.fixed`."""
        return dataclasses.replace(self, adaptive=None)

    def window_innovation(self, model: Model, dt: float, length: int) -> ca.Function:
        """See `AbstractAdaptiveObserver.window_innovation`."""
        ordered, order = moving_first(model)
        form, integrator = observer_form(ordered), self.chosen(model, dt)
        return window_innovation(form, integrator, order, dt=dt, length=length)

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        given = model
        model, order = moving_first(given)
        form = observer_form(model)
        k0 = gain_vector(self.poles, form.n)
        chosen = self.chosen(given, dt)
        x0 = self.prior.mean(given)[order]
        P0 = self.prior.covariance(given)[np.ix_(order, order)]
        Q = self.noise.process(given)[np.ix_(order, order)]
        Qc = self.noise.density(given)[np.ix_(order, order)]
        theta0, J = _combinations(form, x0[form.n :])
        start = chain_start(form, x0, P0, J, Q=Q, Qc=Qc)
        plan = Plan(
            states=States(form, theta0, *state_bounds(model), order),
            gains=ObserverGains(k0, _gamma(self.Gamma, form), consistent=self.form == "consistent"),
            lam=self.gain,
            integrator=chosen,
            interpolation=self.interpolation,
            dt=dt,
            R=float(self.noise.measurement(model)[0, 0]),
            x0=start.x0,
            constants=np.zeros(0),
            P0=start.P0,
            spread=Spread(start.Q, start.Qc, _NOTHING, start.varies),
            adaptive=self.adaptive,
            window=self.excitation,
        )
        return assemble_observer(self.key, plan)


_NOTHING = ca.Function("nothing", [ca.SX.sym("x"), ca.SX.sym("u")], [ca.SX(0, 0)])
"""No constants: there are no states that are neither in the chain nor estimated."""


def _combinations(form: AffineForm, parameters: Array) -> tuple[Array, Array]:
    """Theta (p,) and its Jacobian (p, p) at the start values."""
    p = ca.SX.sym("p", len(parameters))
    theta = form.theta.call([p])[0]
    value, J = ca.Function("start", [p], [theta, ca.jacobian(theta, p)]).call([parameters])
    theta0, jacobian = value.full().ravel(), J.full()
    if not (np.all(np.isfinite(theta0)) and np.all(np.isfinite(jacobian))):
        raise TuningError(
            f"the start values {parameters.tolist()} of {', '.join(form.parameters)} do not "
            f"define {', '.join(form.combinations)}; start a divisor away from zero"
        )
    return theta0, jacobian


def _gamma(given: Array, form: AffineForm) -> Array:
    """Gamma (p, p), checked."""
    p = form.p
    Gamma = np.asarray(given, float)
    Gamma = np.diag(np.full(p, Gamma) if Gamma.ndim == 0 else Gamma) if Gamma.ndim < 2 else Gamma
    names = ", ".join(form.combinations)
    if Gamma.shape != (p, p):
        raise TuningError(f"Gamma has the shape {Gamma.shape}; it must be {(p, p)} for {names}")
    size = np.sqrt(np.abs(np.diag(Gamma)))
    relative = Gamma / np.outer(size, size) if np.all(size > 0) else np.full((p, p), np.nan)
    symmetric = np.allclose(relative, relative.T, rtol=0, atol=1e-9)
    if p and not (symmetric and np.linalg.eigvalsh(relative)[0] > 0):
        smallest = np.linalg.eigvalsh((Gamma + Gamma.T) / 2)[0]
        raise TuningError(
            f"Gamma must be symmetric and positive definite; smallest eigenvalue {smallest:.3g}"
        )
    return Gamma
