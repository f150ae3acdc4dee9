"""Extended Kalman filter, discrete or continuous-discrete."""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca

from backsight.algebra.factor import smallest_pivot
from backsight.algebra.update import masked, measured, noise_of
from backsight.description import Sound
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.estimators.kalman._bucy import assemble_continuous
from backsight.estimators.kalman._linearised import ekf_looks
from backsight.estimators.kalman.exact_sensors import exact_sensors, with_exact_sensors
from backsight.estimators.kalman.prediction import Propagation, predict, transition
from backsight.estimators.kalman.square_root import square_root_halves, wide
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    corrected_covariance,
    innovation_covariance,
    joseph_form,
    kalman_gain,
    matrix_product,
)
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import linear
from backsight.estimators.parts.substeps import seen_outputs, settled
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.smoothing import passes
from backsight.estimators.steady import filter_limit, may_be_worth, reusing_filter
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.lti import is_linear
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
    the model (eq. 13) and the covariance by one of three ways. If the prior is more than a million
    times as wide as the noise, or a sensor has none, both steps work on a factor of the covariance,
    see `backsight.estimators.kalman.square_root`. A reading without noise of what is known exactly
    already is left out, with the status *redundant*.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    integrator : Integrator
        For continuous-time models.
    covariance : {"transition", "ode", "discrete"}
        ``transition`` (default) keeps P positive semidefinite at every step size; ``ode`` is the
        paper's (eq. 14-16), which may not; ``discrete`` adds all noise once per sample. See
        `backsight.estimators.kalman.prediction.predict`.
    measurement : {"sampled", "continuous"}
        ``continuous`` takes the measurement as a signal that goes on between the samples
        (Kalman-Bucy, eq. 13-14 of Riva et al.): it is interpolated, and its noise has the spectral
        density :math:`R_c = R\,\Delta t`. More sub-steps come closer to the continuous filter;
        with short sampling periods there is next to no difference. See
        `backsight.estimators.kalman._bucy`.
    gain : {"converged", "exact"}
        Of linear models with about ten states or more, which go over a sample exactly: the filter
        is then the Kalman filter, and its gain is taken again once it has converged, see
        `KalmanFilter`. ``exact``: it is computed at every sample.

    References
    ----------
    Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics with
    plant uncertainties in nanopositioning system estimation", ACC 2012, section III.
    Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter estimation: a
    comparison to extended and unscented Kalman filter".
    Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, section 13.2.

    Examples
    --------
    >>> spring = bs.augment(bs.sdof(k=35.0, b=0.8), parameters=["k"])
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> ekf = bs.EKF(
    ...     bs.Noise(sigma_y=1e-4),
    ...     bs.Prior(sigma_x0={"q": 0.1, "v": 0.1, "k": 10.0}, x0={"k": 35.0}),
    ... )
    >>> print(f"{float(bs.estimate(ekf, spring, recording, engine='vm').x_hat[-1, 2]):.0f} 1/s2")
    40 1/s2
    """

    key: ClassVar[str] = "ekf"
    title: ClassVar[str] = "Extended Kalman filter"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    looks_back: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q", "R")

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Propagation = "transition"
    measurement: Literal["sampled", "continuous"] = "sampled"
    gain: Literal["converged", "exact"] = "converged"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if (
            sound("measurement", "covariance")
            and self.measurement == "continuous"
            and self.covariance != "transition"
        ):
            yield "measurement='continuous' goes with covariance='transition' only"

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white" if self.measurement == "sampled" else "coloured"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = self._setting(model, dt)
        if self._by_factor and wide(s):
            return assemble(self.key, s, self._halves_of_factor(s))
        reusing = self._reusing(model, s)
        if reusing is not None:
            return reusing
        parts = ekf_halves(s, s.integrator, self.covariance)
        if self.measurement == "sampled":
            return assemble(self.key, s, parts)
        # Noise per sample is spread evenly over the time in which measurements come all the time.
        spread = s.with_noise(lambda Q, Qc: (0 * Q, Qc + Q / dt))
        step = transition(spread, s.integrator)
        return assemble_continuous(self.key, s, parts, transition=step, integrator=s.integrator)

    @property
    def _by_factor(self) -> bool:
        """Whether it can keep a factor of the covariance."""
        return self.measurement == "sampled" and self.covariance != "ode"

    def _setting(self, model: Model, dt: float) -> Setting:
        return setting(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            integrator=self.integrator,
            noiseless=self._by_factor,
        )

    def _halves_of_factor(self, s: Setting) -> Halves:
        kept = s.sampled() if self.covariance == "discrete" else s
        return with_exact_sensors(s, square_root_halves(kept))

    def _reusing(self, model: Model, s: Setting) -> Recursion | None:
        """The Kalman filter that reuses its gain, if this is one and there is a limit."""
        exact = not model.continuous or s.integrator.scheme == "exact"
        known = exact and self.measurement == "sampled" and self.gain == "converged"
        if not (known and may_be_worth(model.nx, model.ny) and is_linear(model)):
            return None
        hold = s.integrator.hold if model.continuous else "zoh"
        system = linear(model, s.dt, noise=self.noise, prior=self.prior, hold=hold)
        limit = filter_limit(system)
        return None if limit is None else reusing_filter(self.key, system, limit)

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`."""
        if self.measurement == "continuous":
            raise TuningError("measurement='continuous' cannot be smoothed; use 'sampled'")
        s = self._setting(model, dt)
        if exact_sensors(s):
            parts = self._halves_of_factor(s)
        else:
            parts = ekf_halves(s, s.integrator, self.covariance)
        looks = ekf_looks(s, s.integrator, parts, at="prior")
        return passes(self.key, s, parts, looks, covariance=covariance)


def ekf_halves(s: Setting, integrator: Integrator, covariance: Propagation) -> Halves:
    """Measurement update and time update, see `EKF`."""
    kept = Covariance(s.model.nx)
    return Halves(
        spread_of=kept.kept,
        innovation=innovation(s),
        correct=correct(s, check=covariance == "ode"),
        predict=predict(s, integrator, covariance),
        covariance=kept.triangle(),
        ramp=integrator.hold == "foh",
    )


def innovation(s: Setting) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance: ``(x, P, u, y, mask) -> (e, S)``."""
    if Covariance(s.model.nx).whole:

        def told(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
            e, H = _looked(s, x, u, y, mask)
            return {"e": e, "S": innovation_covariance(P, H, s.R, mask)}

        return half("innovation", s, told)

    def seen(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        e, noise = measured(mask) * (y - y_prior), noise_of(s.R_at(u), mask)
        return {"e": e, "H": ca.jacobian(y_prior, x), "noise": noise}

    expected = leaf("expected", notation(s), seen)

    def formula(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
        e, H, R = expected(x, u, y, mask)
        return {"e": e, "S": congruence(H, P, R)}

    return half("innovation", s, formula)


def correct(s: Setting, *, check: bool = False) -> ca.Function:
    r"""Measurement update with clipping, eq. 17-20: ``(x, P, u, y, mask) -> (x, P, flags)``.

    Only measured rows are used. States outside their bounds are set to them and P stays as it is
    (section VI.C). With `check` the pivots of P are looked at, where the time update does not keep
    P positive by itself.
    """

    def formula(x: Term, P: Term, u: Term, y: Term, mask: Term) -> Results:
        x_post, P_post, flags = updated(s, x, P, u, y, mask)
        if check:
            indefinite = ca.if_else(smallest_pivot(P) < -1e-10, 1, 0)
            known = ca.fmin(flags.not_positive_definite + indefinite, 1)
            flags = dataclasses.replace(flags, not_positive_definite=known)
        return {"x_post": x_post, "P_post": P_post, "flags": flags.vector()}

    return half("correct", s, formula)


def updated(s: Setting, x: Term, P: Term, u: Term, y: Term, mask: Term) -> tuple[Term, Term, Flags]:
    """State, covariance (nx, nx) and flags after a measurement, in the formula of a `half`."""
    if Covariance(s.model.nx).whole:
        e, H = _looked(s, x, u, y, mask)
        found = corrected_covariance(P, H, s.R, mask)  # eq. 17 and 19
        moved = x + matrix_product(found.K, e)  # eq. 18
        x_post, flags = settled(s)(moved, ca.diag(found.P), ca.diag(found.S))
        return x_post, found.P, Flags.of(flags)

    def seen(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_prior = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_prior, x), y - y_prior, s.R_at(u), mask)  # eq. 20
        return {"e": e, "H": H, "noise": R}

    e, H, R = leaf("residual", notation(s), seen)(x, u, y, mask)
    K, S = kalman_gain(P, H, R)  # eq. 17
    P_post = joseph_form(P, K, H, R)  # eq. 19
    x_post, flags = settled(s)(x + K @ e, ca.diag(P_post), ca.diag(S))  # eq. 18
    return x_post, P_post, Flags.of(flags)


def _looked(s: Setting, x: Term, u: Term, y: Term, mask: Term) -> tuple[ca.MX, ca.MX]:
    """Innovation, 0 where not measured, and the slope H of all outputs, of many states."""
    if any(part.R.any() for part in s.parts):
        raise TuningError("correlations of sensors cannot be inputs of models with many states")
    y_prior, H = seen_outputs(s)(x, u)
    missed = leaf(
        "missed",
        {**notation(s), "expected": s.model.ny},
        lambda y, expected, mask: {"e": measured(mask) * (y - expected)},
    )
    return missed(y, y_prior, mask), H
