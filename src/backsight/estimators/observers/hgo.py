"""High-gain observer."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.description import Positive
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.observers._excitation import Excitation
from backsight.estimators.observers._recursion import Plan, assemble_observer
from backsight.estimators.observers._states import States, state_bounds
from backsight.estimators.observers.formulas import (
    Interpolation,
    ObserverGains,
    Spread,
    check_step,
    gain_vector,
)
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.affine import affine_form, moving_states
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class HGO(AbstractEstimator):
    r"""High-gain observer: derivatives of the output, as fast as the noise allows (eq. 5).

    .. math::
        \dot{\hat x} = A_0 \hat x + \phi(\hat x, u) + \lambda \Lambda^{-1} k_0 (y - c_0 \hat x)

    with :math:`\Lambda^{-1} = \mathrm{diag}(1, \lambda \dots \lambda^{n-1})`. States that are
    constant in the model (parameters) keep their start values; `AHG` estimates them.

    Noise and prior do not change the estimate. They give its covariance, that of the linearised
    error under measurement noise, random walks and an uncertain start; what is not known of the
    constant states counts too.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    gain : float
        Gain lambda [1/s]. The error decays like exp(-lambda t), the noise of the velocity grows
        with lambda^1.5.
    poles : number or n numbers
        Eigenvalues of A0 - k0 c0.
    integrator : Integrator
        `hold` is that of the input.
    interpolation : {"model", "linear", "hold"}
        The measurement between samples, see `formulas.Interpolation`.

    References
    ----------
    Gauthier, Hammouri, Othman (1992), doi:10.1109/9.256352. Riva, Dagen, Ortmaier, "Adaptive
    high-gain observer for joint state and parameter estimation", eq. 1-5.
    """

    key: ClassVar[str] = "hgo"
    title: ClassVar[str] = "High-gain observer"

    noise: Noise
    prior: Prior
    gain: Positive
    poles: complex | tuple[complex, ...] = -1.0
    integrator: Integrator = dataclasses.field(default_factory=lambda: Integrator("rk4", 2))
    interpolation: Interpolation = "model"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        x0, P0 = self.prior.mean(model), self.prior.covariance(model)
        n = len(moving_states(model))
        form = affine_form(_chain(model, n, x0[n:]))
        k0 = gain_vector(self.poles, form.n)
        check_step(self.gain, k0, self.integrator, dt)
        lower, upper = state_bounds(model)
        plan = Plan(
            states=States(form, np.zeros(0), lower, upper),
            gains=ObserverGains(k0, np.zeros((0, 0))),
            lam=self.gain,
            integrator=self.integrator,
            interpolation=self.interpolation,
            dt=dt,
            R=float(self.noise.measurement(model)[0, 0]),
            x0=x0[:n],
            constants=x0[n:],
            P0=P0,
            spread=Spread(self.noise.process(model, dt), _influence(model, n, x0[n:])),
            adaptive=None,
            window=Excitation(),
        )
        return assemble_observer(self.key, plan)


def _chain(model: Model, n: int, constants: Array) -> Model:
    """The model of the first n states, with the other states at their start values."""
    x, u = ca.SX.sym("x", n), ca.SX.sym("u", model.nu)
    p = ca.SX.sym("p", len(model.parameters))
    full = ca.vertcat(x, constants)
    return dataclasses.replace(
        model,
        f=ca.Function("f", [x, u, p], [model.f.call([full, u, p])[0][:n]]),
        h=ca.Function("h", [x, u, p], model.h.call([full, u, p])),
        states=model.states[:n],
    )


def _influence(model: Model, n: int, constants: Array) -> ca.Function:
    """``(x, u) -> (n, q)``: derivative of the chain's equations by the constants."""
    x, u, c = ca.SX.sym("x", n), ca.SX.sym("u", model.nu), ca.SX.sym("c", len(constants))
    slope = ca.jacobian(model.rhs(ca.vertcat(x, c), u)[:n], c)
    return ca.Function("influence", [x, u], [ca.substitute(slope, c, ca.SX(constants))])
