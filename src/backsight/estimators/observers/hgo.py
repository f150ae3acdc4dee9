"""High-gain observer."""

import dataclasses
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.description import Positive
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import Recursion
from backsight.errors import ModelError
from backsight.estimators.observers._excitation import Excitation
from backsight.estimators.observers._formulas import (
    Interpolation,
    ObserverGains,
    Spread,
)
from backsight.estimators.observers._high_gain import AbstractHighGain
from backsight.estimators.observers._recursion import Plan, assemble_observer
from backsight.estimators.observers._states import States, chain_start, state_bounds
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.canonical.affine import AffineForm, moving_states
from backsight.models.canonical.observer_form import gain_vector, moving_first, observer_form
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class HGO(AbstractHighGain):
    r"""High-gain observer: derivatives of the output, as fast as the noise allows (eq. 5).

    .. math::
        \dot{\hat x} = A_0 \hat x + \phi(\hat x, u) + \lambda \Lambda^{-1} k_0 (y - c_0 \hat x)

    with :math:`\Lambda^{-1} = \mathrm{diag}(1, \lambda \dots \lambda^{n-1})`. A model that is no
    such chain is observed in the coordinates in which it is one, the output and its derivatives
    :math:`\Phi(x)` (see `observer_form`); the result has its own states, as from the gain
    :math:`(\partial\Phi/\partial x)^{-1} \lambda \Lambda^{-1} k_0` in them. States that are
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
        The measurement between samples: along the prediction of the model, by straight lines,
        or held, which delays it by half a sampling period.

    References
    ----------
    Gauthier, Hammouri, Othman (1992), doi:10.1109/9.256352. Riva, Dagen, Ortmaier, "Adaptive
    high-gain observer for joint state and parameter estimation", eq. 1-5.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=1.0)
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> result = bs.estimate(
    ...     bs.HGO(noise, prior, gain=5.0), bs.sdof(k=40.0, b=0.8), recording, engine="vm"
    ... )
    >>> abs(float(result.e[-1, 0])) < 1e-3
    True
    """

    key: ClassVar[str] = "hgo"
    title: ClassVar[str] = "High-gain observer"

    noise: Noise
    prior: Prior
    gain: Positive
    poles: complex | tuple[complex, ...] = -1.0
    integrator: Integrator = dataclasses.field(default_factory=lambda: Integrator("rk4"))
    interpolation: Interpolation = "model"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        given = model
        model, order = moving_first(given)
        x0 = self.prior.mean(given)[order]
        P0 = self.prior.covariance(given)[np.ix_(order, order)]
        Q = self.noise.process(given)[np.ix_(order, order)]
        Qc = self.noise.density(given)[np.ix_(order, order)]
        n = len(moving_states(model))
        form = observer_form(_chain(model, n, x0[n:]))
        _check_output(model, n)
        k0 = gain_vector(self.poles, form.n)
        chosen = self.chosen(given, dt)
        lower, upper = state_bounds(model)
        start = chain_start(form, x0, P0, np.zeros((0, 0)), Q=Q, Qc=Qc)
        plan = Plan(
            states=States(form, np.zeros(0), lower, upper, order),
            gains=ObserverGains(k0, np.zeros((0, 0))),
            lam=self.gain,
            integrator=chosen,
            interpolation=self.interpolation,
            dt=dt,
            R=float(self.noise.measurement(model)[0, 0]),
            x0=start.x0,
            constants=x0[n:],
            P0=start.P0,
            spread=Spread(start.Q, start.Qc, _influence(model, form, x0[n:]), start.varies),
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
        virtual=None,
    )


def _check_output(model: Model, n: int) -> None:
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    y = model.output(x, u)
    held = [model.states[k].name for k in range(n, model.nx) if ca.depends_on(y, x[k])]
    if held:
        raise ModelError(
            f"the output contains the constant state {', '.join(held)}, which an observer of the "
            "others takes for exact; make it a parameter of the model"
        )


def _influence(model: Model, form: AffineForm, constants: Array) -> ca.Function:
    """``(x, u) -> (n, q)``: derivative of the chain's equations by the constants.

    The coordinates stay those of the start values: their observer errs with the states.
    """
    n = form.n
    z, u, c = ca.SX.sym("x", n), ca.SX.sym("u", model.nu), ca.SX.sym("c", len(constants))
    x = z if form.coordinates is None else form.coordinates.states.call([z])[0]
    slope = ca.jacobian(model.rhs(ca.vertcat(x, c), u)[:n], c)
    if form.coordinates is not None:
        slope = form.coordinates.slope.call([x])[0] @ slope
    return ca.Function("influence", [z, u], [ca.substitute(slope, c, ca.SX(constants))])
