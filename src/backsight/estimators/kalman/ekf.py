"""Extended Kalman filter, discrete or continuous-discrete."""

import dataclasses
from typing import ClassVar

import casadi as ca

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import UNROLL
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Setting, setting
from backsight.estimators.kalman._bucy import assemble_continuous
from backsight.estimators.parts import gaussian, large
from backsight.estimators.parts.filtering import Halves, assemble, packed
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations


@dataclasses.dataclass(frozen=True)
class EKF(AbstractEstimator):
    r"""Extended Kalman filter.

    At every sample k it first corrects the prior with the measurement (eq. 17-20),

    .. math::
        e_k = y_k - h(\hat x_k^-, u_k), \quad S_k = H_k P_k^- H_k' + R, \quad
        K_k = P_k^- H_k' S_k^{-1}, \quad \hat x_k^+ = \hat x_k^- + K_k e_k,

        P_k^+ = (I - K_k H_k) P_k^- (I - K_k H_k)' + K_k R K_k',

    sets states outside their bounds to them, and then carries the estimate to the next sample by
    the model (eq. 13) and the covariance by one of three ways.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    integrator : Integrator
        For continuous-time models.
    covariance : {"transition", "ode", "discrete"}
        ``transition`` (default) keeps P positive semidefinite at every step size; ``ode`` is the
        paper's (eq. 14-16), which may not; ``discrete`` adds Q once per sample. See
        `backsight.estimators.parts.gaussian.predict`.
    measurement : {"sampled", "continuous"}
        ``continuous`` takes the measurement as a signal that goes on between the samples
        (Kalman-Bucy, eq. 13-14 of Riva et al.): it is interpolated, and its noise has the spectral
        density :math:`R_c = R\,\Delta t`. More sub-steps come closer to the continuous filter;
        with short sampling periods there is next to no difference. See
        `backsight.estimators.kalman._bucy`.

    References
    ----------
    Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
    plant uncertainties in nanopositioning system estimation", ACC 2012, section III.
    Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter estimation: a
    comparison to extended and unscented Kalman filter".
    Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, section 13.2.
    """

    key: ClassVar[str] = "ekf"
    title: ClassVar[str] = "Extended Kalman filter"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: str = "transition"
    measurement: str = "sampled"

    def __post_init__(self) -> None:
        if self.measurement not in ("sampled", "continuous"):
            raise TuningError(
                f"unknown measurement '{self.measurement}': use 'sampled' or 'continuous'"
            )
        if self.measurement == "continuous" and self.covariance != "transition":
            raise TuningError("measurement='continuous' goes with covariance='transition' only")

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white" if self.measurement == "sampled" else "coloured"

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior)
        if self.measurement == "continuous":
            return assemble_continuous(self.key, s, self.integrator)
        return assemble(self.key, s, halves(s, self.integrator, self.covariance))


def halves(s: Setting, integrator: Integrator, covariance: str) -> Halves:
    """Measurement update and time update, see `EKF`."""
    return (_large if s.model.nx > UNROLL else _small)(s, integrator, covariance)


def _small(s: Setting, integrator: Integrator, covariance: str) -> Halves:
    P = ca.SX.sym("P", len(packed(s.P0)))
    return Halves(
        spread0=packed(s.P0),
        innovation=gaussian.innovation(s),
        correct=gaussian.correct(s, check=covariance == "ode"),
        predict=gaussian.predict(s, integrator, covariance),
        covariance=ca.Function("covariance", [P], [P]),
        ramp=integrator.hold == "foh",
    )


def _large(s: Setting, integrator: Integrator, covariance: str) -> Halves:
    return Halves(
        spread0=s.P0.ravel(),
        innovation=large.innovation(s),
        correct=large.correct(s),
        predict=large.predict(s, integrator, covariance),
        covariance=large.covariance(s.model.nx),
        ramp=integrator.hold == "foh",
    )
