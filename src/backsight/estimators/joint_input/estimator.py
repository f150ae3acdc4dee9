"""Joint estimation of states and forces of which nothing is known (Gillijns and De Moor)."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

import casadi as ca
import numpy as np

from backsight.description import Called, Distinct, Range, Sound
from backsight.discrete.runge_kutta import Hold, Integrator
from backsight.engine.recursion import Channel, ForwardBackward, Recursion
from backsight.errors import ModelError, TuningError
from backsight.estimators.around.virtual import CROSS
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Spread
from backsight.estimators.joint_input._exact import exact_extended_step, exact_step, spread_of_prior
from backsight.estimators.joint_input._extended import at_prior, extended_step
from backsight.estimators.joint_input._reused import joint_limit, reusing_joint
from backsight.estimators.joint_input._smoothing import joint_passes
from backsight.estimators.joint_input._step import step
from backsight.estimators.joint_input._system import Forces, forces_of
from backsight.estimators.kalman.exact_sensors import exact_sensors
from backsight.estimators.kalman.square_root import refuse_too_wide
from backsight.estimators.parts.covariance import Term
from backsight.estimators.parts.filtering import physical
from backsight.estimators.parts.leaf import named_results
from backsight.estimators.parts.linear import linear
from backsight.estimators.parts.memory import Memory
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import bent
from backsight.models.model import Model
from backsight.models.sampling import check_sampling
from backsight.models.signals import vector
from backsight.schema import Innovations
from backsight.types import Array

UNKNOWN = 1e4
"""Standard deviation of a force that was not seen, in those which the sensors' noise would give it
at a complete sample."""


@dataclasses.dataclass(frozen=True)
class JointInput(AbstractEstimator):
    r"""Joint input and state filter.

    For models with forces d that may do anything from one sample to the next, linear ones and, by
    linearisation at every estimate, others, such as those with an unknown stiffness as a state:

    .. math:: x_{k+1} = A x_k + B u_k + E d_k + w_k, \qquad y_k = C x_k + D u_k + F d_k + v_k :

    the unbiased estimate of states and forces with the smallest variance. With the innovation
    :math:`e_k = y_k - C \hat x_k^- - D u_k`, its covariance without forces
    :math:`S_k = C P_k^- C' + R`, and :math:`K_k = P_k^- C' S_k^{-1}`,

    .. math::
        \hat d = M_k e_k, \quad M_k = (H' S_k^{-1} H)^{-1} H' S_k^{-1}, \qquad
        \hat x_k^+ = \hat x_k^- + G \hat d + K_k (e_k - H \hat d) .

    Without feedthrough (F = 0: displacements, velocities, strains) :math:`H = C E, G = E`, and the
    force that is found at sample k is the one that acted *before* it, :math:`d_{k-1}`. With
    feedthrough (accelerations) :math:`H = F, G = 0`, the force is :math:`d_k`, and it enters the
    prediction :math:`\hat x_{k+1}^- = A \hat x_k^+ + B u_k + E \hat d`.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    forces : tuple of str
        Parameters of the model that are unknown forces; at most as many as there are sensors.
    hold : {"zoh", "foh"}
        Known inputs between the samples of a continuous model: held, or interpolated. The unknown
        forces are held.
    sigma_force : dict or number, optional
        Standard deviation per sample, as white noise, of the forces at samples whose measurements
        do not determine them [their unit]; by default 1e4 times what the noise of the sensors alone
        would make of it, with sensors that have none, what it and the prior would.
    gain : {"converged", "exact"}
        Of linear models with more than a dozen states, as for `KalmanFilter`.

    Notes
    -----
    The result has more variables: ``d_hat (time, force)``, its standard deviation ``d_std`` and
    covariance ``P_d``. ``e`` and ``S`` are those of a motion without forces, so that the NIS is
    large while a force acts.

    Rows that were not measured are left out. If those that remain do not determine all forces, the
    forces of this sample get the mean zero and the standard deviation `sigma_force`; the
    covariances count that, and the status says *unobserved*. The same is said of the force before
    the first sample, without a status. Sensors may have no noise (``sigma_y = 0``): see
    `backsight.estimators.joint_input._exact`.

    References
    ----------
    Gillijns, De Moor, "Unbiased minimum-variance input and state estimation for linear
    discrete-time systems", 2007, Automatica 43(1), 111-116, doi:10.1016/j.automatica.2006.08.002;
    the same with direct feedthrough: 43(5), 934-937, doi:10.1016/j.automatica.2006.11.016.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-6), bs.Prior(sigma_x0=1e-3)
    >>> estimator = bs.JointInput(noise, prior, forces=("load",), hold="foh")
    >>> estimator.forces, estimator.hold
    (('load',), 'foh')
    """

    key: ClassVar[str] = "joint_input"
    title: ClassVar[str] = "Joint input and state filter"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    forces: Annotated[tuple[str, ...], Distinct(), Called("forces")]
    hold: Hold = "zoh"
    sigma_force: Annotated[
        Mapping[str, float] | float | None, Range("be positive", 0.0, above=True)
    ] = None
    gain: Literal["converged", "exact"] = "converged"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("forces") and not self.forces:
            yield "forces: no unknown force is named"

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "forced"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        if bent(model):
            forces = self._linearised(model, dt)
            refuse_too_wide(forces.system.s, "JointInput")
            return _extended(self.key, forces, cross=model.virtual is not None)
        forces = self._forces(model, dt)
        refuse_too_wide(forces.system.s, "JointInput")
        exact = self.gain == "exact" or exact_sensors(forces.system.s)
        ends = None if exact else joint_limit(forces)
        if ends is not None:
            channels = _channels(forces, cross=model.virtual is not None)
            return reusing_joint(self.key, forces, ends, _data(forces), channels)
        return _recursion(self.key, forces, cross=model.virtual is not None)

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`; the forces are smoothed, too."""
        if bent(model):
            raise TuningError(
                f"{self.title} smooths linear models only; '{model.name}' is not: use estimate, or "
                "EKF with a force that has dynamics (bs.forces)"
            )
        found, cross = self._forces(model, dt), model.virtual is not None
        return joint_passes(self.key, found, covariance=covariance, cross=cross)

    def _joined(self, model: Model) -> Model:
        try:
            return forces_as_inputs(model, self.forces)
        except ModelError as error:
            raise TuningError(f"forces: {error}") from None

    def _linearised(self, model: Model, dt: float) -> Forces:
        """Forces of a nonlinear model, at the prior's mean."""
        if self.hold != "zoh":
            raise TuningError("a nonlinear model needs inputs that are held: hold = 'zoh'")
        joined = self._joined(model)
        s = setting(
            joined, dt, noise=self.noise, prior=self.prior, integrator=Integrator(hold=self.hold),
            noiseless=True,
        )  # fmt: skip
        found = forces_of(at_prior(s), self.forces)
        return dataclasses.replace(found, spread=self._spread(found, joined))

    def _forces(self, model: Model, dt: float) -> Forces:
        joined = self._joined(model)
        system = linear(
            joined, dt, noise=self.noise, prior=self.prior, hold=self.hold, noiseless=True
        )
        check_sampling(joined, dt)
        found = forces_of(system, self.forces)
        return dataclasses.replace(found, spread=self._spread(found, joined))

    def _spread(self, found: Forces, joined: Model) -> Array:
        """Covariance of forces that the measurements do not determine, scaled, (m, m)."""
        if self.sigma_force is None:
            R = _of_sensors(found.system.s, found.system.C)
            information = found.H.T @ np.linalg.solve(R, found.H)
            return np.asarray(UNKNOWN**2 * np.linalg.inv(information), float)
        signals = joined.inputs[-len(self.forces) :]
        missing = np.full(len(signals), np.nan)
        try:
            sigma = vector(self.sigma_force, signals, what="sigma_force", default=missing)
        except ModelError as error:
            raise TuningError(str(error)) from None
        bad = [s.name for s, v in zip(signals, sigma, strict=True) if not 0 < v < np.inf]
        if bad:
            raise TuningError(f"sigma_force must be positive and finite for {', '.join(bad)}")
        return np.diag((sigma / found.unit) ** 2)


def _of_sensors(s: Setting, C: Array) -> Array:
    """Covariance of the sensors, scaled; where some are exact, variances with the prior's."""
    if not exact_sensors(s):
        return s.R
    shown = np.diag(s.R + C @ s.P0 @ C.T)
    if not (shown > 0).all():
        raise TuningError(
            "sensors have no noise and the prior says exactly what they will show: give "
            "sigma_force, the standard deviation of a force that is not seen"
        )
    return np.diag(shown)


def _recursion(name: str, found: Forces, *, cross: bool) -> Recursion:
    """The filter; with the channel `CROSS` if virtual outputs need it."""
    s = found.system.s
    m = Memory(x=s.x0, P=spread_of_prior(s), started=0)
    data = _data(found)
    go = exact_step(found) if exact_sensors(s) else step(found)
    now = named_results(go, m.x, m.P, m.started, *data)
    after = {"x": now["x_next"], "P": now["P_next"], "started": 1}
    outputs, channels = _outputs(found, now, cross=cross), _channels(found, cross=cross)
    return m.recursion(name, data, next=after, outputs=outputs, channels=channels, dt=s.dt)


def _extended(name: str, found: Forces, *, cross: bool) -> Recursion:
    """The recursion of a nonlinear model, see `_recursion`."""
    s = found.system.s
    m = Memory(x=s.x0, P=spread_of_prior(s), E=np.zeros(found.E.shape), started=0)
    data = _data(found)
    go = exact_extended_step(found) if exact_sensors(s) else extended_step(found)
    now = named_results(go, m.x, m.P, m.E, m.started, *data)
    after = {"x": now["x_next"], "P": now["P_next"], "E": now["E_next"], "started": 1}
    outputs, channels = _outputs(found, now, cross=cross), _channels(found, cross=cross)
    return m.recursion(name, data, next=after, outputs=outputs, channels=channels, dt=s.dt)


def _data(found: Forces) -> list[ca.MX]:
    sizes = {"u": found.nu, "y": found.system.s.model.ny, "m": found.system.s.model.ny}
    return [ca.MX.sym(n, k) for n, k in sizes.items()]


def _outputs(found: Forces, now: dict[str, Term], *, cross: bool) -> dict[str, Term]:
    estimate = physical(
        found.system.s,
        x=now["x_post"],
        P=now["triangle"],
        u=now["v"],
        e=now["e"],
        S=now["spread"],
        flags=now["flags"],
    )
    outputs = {**estimate, "d_hat": now["d"], "P_d": now["d_triangle"]}
    if cross:
        nx = found.system.s.model.nx
        outputs[CROSS] = found.cross()(now["joint"][:nx, nx:])
    return outputs


def _channels(found: Forces, *, cross: bool) -> tuple[Channel, ...]:
    channels = (
        *ESTIMATE_CHANNELS,
        Channel("d_hat", ("force",), labels=found.names, ago=0 if found.direct else 1),
        Channel("P_d", ("force", "force_"), symmetric=True, labels=found.names),
    )
    return (*channels, Channel(CROSS, ("state", "force"))) if cross else channels
