"""Kalman filter for linear models: time-varying, or with the gain of the steady state."""

import dataclasses
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import scipy

from backsight.discrete.runge_kutta import Hold, Integrator
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.estimators.kalman import ekf
from backsight.estimators.kalman._linearised import linear_looks
from backsight.estimators.kalman.exact_sensors import exact_sensors, with_exact_sensors
from backsight.estimators.kalman.prediction import predict
from backsight.estimators.kalman.square_root import refuse_too_wide, square_root_halves, wide
from backsight.estimators.parts.covariance import Covariance, Term, congruence, matrix_product
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.fixed_gain import correct_with
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.linear import Linear, Varying, in_time
from backsight.estimators.scaled import Setting
from backsight.estimators.smoothing import passes
from backsight.estimators.steady import filter_limit, reusing_filter
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class KalmanFilter(AbstractEstimator):
    r"""Kalman filter.

    For linear models, with :math:`x_{k+1} = A x_k + B u_k + w_k`, :math:`y_k = C x_k + D u_k + v_k`
    and white noise of the covariances Q and R: the estimate with the smallest variance. The
    matrices may change with known inputs, ``a * cos(angle)`` for a state a and an input `angle`;
    with a constant term the model is one of these, too.

    .. math::
        e_k = y_k - C \hat x_k^- - D u_k, \quad S_k = C P_k^- C' + R, \quad
        K_k = P_k^- C' S_k^{-1}, \quad \hat x_k^+ = \hat x_k^- + K_k e_k,

        P_k^+ = (I - K_k C) P_k^- (I - K_k C)' + K_k R K_k', \qquad
        \hat x_{k+1}^- = A \hat x_k^+ + B u_k, \quad P_{k+1}^- = A P_k^+ A' + Q .

    Continuous models are carried over exactly: the state by a matrix exponential, the noise by
    Van Loan's integral; where matrices change within a sampling period (``hold = "foh"``), by the
    method of Magnus, see `backsight.discrete.varying`. States outside their bounds are set to them,
    and priors that are far wider than the noise are kept as factors, as by `EKF`, unless matrices
    change. So it is with sensors without noise (``sigma_y = 0``), which `EKF` and `UKF` take, too.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    hold : {"zoh", "foh"}
        Input between the samples of a continuous model: held, or interpolated. An angle or the
        time as an input goes on between the samples: ``foh``.
    steady_state : bool
        Use the gain of the algebraic Riccati equation from the first sample on. The covariance
        that is put out is still that of the estimate, start and missing samples included.
    gain : {"converged", "exact"}
        Of models with about ten states or more. The covariance does not depend on the data.
        ``converged``: once it has come to its limit, which is known at compilation, its gain is
        taken again and again, while all channels are measured with their nominal noise; that
        changes the estimate by less than 1e-10 standard deviations, see
        `backsight.estimators.steady.state`. After a sample of another kind the covariance is
        computed until it has come back. ``exact``: it is computed at every sample.

    References
    ----------
    Kalman, "A new approach to linear filtering and prediction problems", 1960,
    doi:10.1115/1.3662552.
    Simon, "Optimal State Estimation", 2006, doi:10.1002/0470045345, chapters 5 and 7.

    Examples
    --------
    >>> recording = bs.simulate(bs.sdof(k=40.0, b=0.8), [[1.0]] * 80, dt=0.05, sigma_y=1e-4, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-4, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> result = bs.estimate(kf, bs.sdof(k=40.0, b=0.8), recording, engine="vm")
    >>> result.x_hat.dims, result.state.values.tolist()
    (('time', 'state'), ['q', 'v'])
    """

    key: ClassVar[str] = "kf"
    title: ClassVar[str] = "Kalman filter"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q", "R")

    noise: Noise
    prior: Prior
    hold: Hold = "zoh"
    steady_state: bool = False
    gain: Literal["converged", "exact"] = "converged"

    @property
    def constant_gain(self) -> bool:
        """See `AbstractEstimator.constant_gain`."""
        return self.steady_state

    def filters_exactly(self, s: Setting) -> bool:
        """See `AbstractEstimator.filters_exactly`; a wide prior needs a factor."""
        return not (self.steady_state or wide(s))

    def varied(self, *, parameters: bool) -> AbstractEstimator:
        """See `AbstractEstimator.varied`: never with the gain of one steady state."""
        if parameters:
            return ekf.EKF(self.noise, self.prior, Integrator(hold=self.hold))
        return dataclasses.replace(self, steady_state=False)

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        system = self._system(model, dt, noiseless=not self.steady_state)
        if isinstance(system, Varying):
            if self.steady_state:
                _constant(system)
            refuse_too_wide(system.s, "matrices that change", linearised=system.at_rest)
            return assemble(self.key, system.s, linear_halves(system, ekf.correct(system.s)))
        if self.steady_state:
            return assemble(self.key, system.s, fixed_gain_halves(system, _riccati(system)[0]))
        if wide(system.s):
            return assemble(self.key, system.s, halves_of_factor(system))
        found = filter_limit(system) if self.gain == "converged" else None
        if found is not None:
            return reusing_filter(self.key, system, found)
        return assemble(self.key, system.s, linear_halves(system, ekf.correct(system.s)))

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`; exact, whatever `steady_state` says."""
        system = self._system(model, dt, noiseless=True)
        if isinstance(system, Linear) and exact_sensors(system.s):
            halves = halves_of_factor(system)
        else:
            halves = linear_halves(system, ekf.correct(system.s))
        looks = linear_looks(system, halves)
        return passes(self.key, system.s, halves, looks, covariance=covariance)

    def steady(self, model: Model, dt: float) -> tuple[Array, Array]:
        """Gain K (nx, ny) and covariance of the one-step prediction (nx, nx) in the steady state.

        Physical units.

        Raises
        ------
        TuningError
            If there is no steady state.
        """
        system = _constant(self._system(model, dt))
        K, P = _riccati(system)
        s = system.s
        return K * s.sx[:, None] / s.sy, P * np.outer(s.sx, s.sx)

    def _system(self, model: Model, dt: float, *, noiseless: bool = False) -> Linear | Varying:
        return in_time(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            hold=self.hold,
            noiseless=noiseless,
        )


def linear_halves(system: Linear | Varying, correct: ca.Function) -> Halves:
    """Halves of a filter of a linear model with the given measurement update."""
    kept = Covariance(system.s.model.nx)
    return Halves(
        spread_of=kept.kept,
        innovation=ekf.innovation(system.s),
        correct=correct,
        predict=predict_linear(system),
        covariance=kept.triangle(),
        ramp=system.ramp,
    )


def halves_of_factor(system: Linear) -> Halves:
    """Halves with a factor of the covariance, for wide priors and sensors without noise."""
    ramp = ramp_end(system) if system.ramp else None
    return with_exact_sensors(system.s, square_root_halves(system.s, ramp=ramp))


def fixed_gain_halves(system: Linear, gain: Array) -> Halves:
    """Halves of a filter that corrects with a constant gain (nx, ny)."""
    return linear_halves(system, correct_with(system, gain))


def predict_linear(system: Linear | Varying) -> ca.Function:
    """Time update ``(x, P, u, u_next) -> (x, P)``: A P A' + Q; see `Covariance`."""
    s = system.s
    if isinstance(system, Varying):
        return _predict_varying(system)
    held = predict(s, s.integrator, "discrete")
    if not system.ramp:
        return held
    ramp = ramp_end(system)
    kept = Covariance(s.model.nx)

    def formula(x: Term, spread: Term, u: Term, u_next: Term) -> Results:
        moved, P = held(x, spread, u, u)
        return {"x_end": ramp(moved, u_next), "spread_next": P}

    return half("predict_ramp", s, formula, {"spread": kept.size})


def _predict_varying(system: Varying) -> ca.Function:
    s, kept = system.s, Covariance(system.s.model.nx)
    nx, nu = s.model.nx, s.model.nu

    def formula(x: Term, spread: Term, F: Term, b: Term, noise: Term) -> Results:
        moved = congruence(F, kept.opened(spread), noise)
        return {"x_next": matrix_product(F, x) + b, "spread_next": kept.closed(moved)}

    sizes = {"spread": kept.size, "b": nx, "noise": (nx, nx)}
    go = half("predict_varying", s, formula, sizes)
    x, spread = ca.MX.sym("x", nx), ca.MX.sym("spread", kept.size)
    u, v = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    return ca.Function("predict", [x, spread, u, v], list(go(x, spread, *system.transitions(u, v))))


def ramp_end(system: Linear) -> ca.Function:
    """``(x, u_next) -> x``: what the input at the end of the period adds."""
    B, sizes = ca.sparsify(ca.DM(system.B_next)), notation(system.s)
    return leaf("ramp_end", sizes, lambda x, u_next: {"x_end": x + ca.mtimes(B, u_next)})


def _constant(system: Linear | Varying) -> Linear:
    """The system, if it can have a steady state."""
    if isinstance(system, Linear):
        return system
    raise TuningError(
        f"model '{system.s.model.name}' has coefficients that change with its inputs, or a "
        "constant term, and no steady state; use steady_state = false"
    )


def _riccati(system: Linear) -> tuple[Array, Array]:
    """Gain and covariance of the prediction, scaled."""
    s, A, C = system.s, system.A, system.C
    try:
        P = scipy.linalg.solve_discrete_are(A.T, C.T, s.Q, s.R)
        K = np.linalg.solve(C @ P @ C.T + s.R, C @ P).T
        radius = np.abs(np.linalg.eigvals(A - A @ K @ C)).max()
    except (ValueError, np.linalg.LinAlgError):
        radius = np.inf
    if not radius < 1 - 1e-9:
        raise TuningError(
            "the Kalman filter has no steady state: a mode that does not decay is unobservable, or "
            "no noise drives it; give every such state process noise (a constant needs some, too), "
            "or use steady_state = false"
        )
    return K, P
