"""Iterated extended Kalman filter."""

import dataclasses
from typing import ClassVar

import casadi as ca

from backsight.algebra.factor import smallest_pivot
from backsight.algebra.update import masked
from backsight.description import Count, NonNegative
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import all_entries, scaled_rows
from backsight.engine.loops import iterate
from backsight.engine.recursion import ForwardBackward, Recursion
from backsight.estimators.base import AbstractEstimator, Spread
from backsight.estimators.kalman._iterated_exactly import iterated_exactly
from backsight.estimators.kalman._linearised import ekf_looks
from backsight.estimators.kalman.ekf import correct, ekf_halves
from backsight.estimators.kalman.exact_sensors import exact_sensors, with_exact_sensors
from backsight.estimators.kalman.prediction import Propagation
from backsight.estimators.kalman.square_root import refuse_too_wide, square_root_halves, wide
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    inner_product,
    matrix_product,
    times_transposed,
    turned_product,
)
from backsight.estimators.parts.factors import solve_definite
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.stages import noise_seen
from backsight.estimators.parts.substeps import seen_outputs, within_bounds
from backsight.estimators.scaled import Setting, setting
from backsight.estimators.smoothing import passes
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations

UNKNOWN = 1e300
"""Cost before the first step."""

NEGATIVE = -1e-10
"""A smaller pivot of a covariance, in units of its variance, is no rounding."""

ROUNDING = 1e-12
"""By how much, relatively, the cost of a step may be higher because of rounding."""


@dataclasses.dataclass(frozen=True)
class IEKF(AbstractEstimator):
    r"""Iterated extended Kalman filter.

    The `EKF` linearises the output at the prior. Here the output is linearised again at the
    result, until nothing changes:

    .. math::
        \hat x_{i+1} = \hat x^- + K_i \bigl(y - h(\hat x_i) - H_i (\hat x^- - \hat x_i)\bigr),
        \quad K_i = P^- H_i' (H_i P^- H_i' + R)^{-1}, \quad \hat x_0 = \hat x^-.

    These are the Gauss-Newton steps to the maximum a posteriori estimate, the minimum of

    .. math::
        J(x) = \tfrac12 (y - h(x))' R^{-1} (y - h(x))
             + \tfrac12 (x - \hat x^-)' (P^-)^{-1} (x - \hat x^-).

    The first step is that of the EKF. A later one that does not lower J is halved until it does,
    so that the result is never less likely than that of the EKF. The covariance is that of the
    EKF with the Jacobian of the last linearisation; prediction is that of the EKF. Readings of
    sensors without noise are equations that the result obeys, see
    `backsight.estimators.kalman._iterated_exactly`.

    Parameters
    ----------
    noise : Noise
    prior : Prior
    integrator : Integrator
        For continuous-time models.
    covariance : {"transition", "ode", "discrete"}
        As in `EKF`.
    max_iterations : int
        Largest number of steps per sample; 1 is the EKF.
    tolerance : float
        The steps end when the next one is shorter than this, measured in standard deviations of
        the prior. With 0 exactly `max_iterations` steps are made, and a sample that has not
        converged is not reported.

    Raises
    ------
    TuningError
        If `max_iterations` or `tolerance` is out of its range.

    References
    ----------
    Bell, Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE Transactions
    on Automatic Control 38 (1993) 294-297, doi:10.1109/9.250476.

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0)
    >>> iekf = bs.IEKF(noise, prior, max_iterations=5)
    >>> iekf.key, iekf.tolerance
    ('iekf', 1e-06)
    """

    key: ClassVar[str] = "iekf"
    title: ClassVar[str] = "Iterated extended Kalman filter"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    looks_back: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q", "R")

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: Propagation = "transition"
    max_iterations: Count = 10
    tolerance: NonNegative = 1e-6

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white"

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        s = self._setting(model, dt)
        by_factor = self.covariance != "ode"
        if not by_factor:
            refuse_too_wide(s, "IEKF with covariance 'ode'")
        return assemble(self.key, s, self._halves(s, by_factor=by_factor and wide(s)))

    def smoother(self, model: Model, dt: float, *, covariance: Spread) -> ForwardBackward:
        """See `AbstractEstimator.smoother`."""
        s = self._setting(model, dt)
        parts = self._halves(s, by_factor=exact_sensors(s))
        looks = ekf_looks(s, s.integrator, parts, at="estimate")
        return passes(self.key, s, parts, looks, covariance=covariance)

    def _setting(self, model: Model, dt: float) -> Setting:
        return setting(
            model,
            dt,
            noise=self.noise,
            prior=self.prior,
            integrator=self.integrator,
            noiseless=self.covariance != "ode",
        )

    def _halves(self, s: Setting, *, by_factor: bool) -> Halves:
        """Those of the EKF, with an iterated measurement update; on a factor of P if asked."""
        limit, tolerance = self.max_iterations, self.tolerance
        if by_factor:
            once = square_root_halves(s.sampled() if self.covariance == "discrete" else s)
            return with_exact_sensors(
                s, iterated_exactly(s, once, limit=limit, tolerance=tolerance)
            )
        once = ekf_halves(s, s.integrator, self.covariance)
        iterated = _correct(s, limit, tolerance)
        return dataclasses.replace(once, correct=iterated, iterated=True)


def _correct(s: Setting, limit: int, tolerance: float) -> ca.Function:
    """Iterated measurement update, ``(x, P, u, y, mask) -> (x, P, flags)``.

    Estimates are x = x_prior + P w, so that P is never inverted and may be singular.
    """
    nx, once = s.model.nx, correct(s)
    given = [ca.MX.sym(once.name_in(i), *once.size_in(i)) for i in range(once.n_in())]
    x, P, *data = given
    start = [ca.MX(1), ca.MX.zeros(nx), ca.MX.zeros(nx), ca.MX(UNKNOWN), ca.MX(1)]
    go, w, w_last, _, _ = iterate(_step(s, tolerance), limit, carry=start, constants=given)
    # P as the EKF has it that linearises where the last step began.
    moved = _moved(s)
    _, P_post, flags = once(moved(x, P, w_last), P, *data)
    # A linearisation far away, after an outlier, may leave P to rounding alone.
    pivot = half("smallest_pivot", s, _pivot)(P_post)
    x_post, raised = _finished(s, tolerance)(moved(x, P, w), go, flags, pivot)
    return ca.Function("iterated_correct", given, [x_post, P_post, raised])


def _step(s: Setting, tolerance: float) -> ca.Function:
    """One Gauss-Newton step, ``(go, w, w_last, J, t, ...) -> (go, w, w_last, J, t)``.

    J is the cost at w, t the share of the step that is tried, w_last is where the step to w began.
    """
    measure, judge = _measurement(s), _judge(s, tolerance)
    nx = s.model.nx

    def formula(
        go: Term, w: Term, w_last: Term, J: Term, t: Term,
        x: Term, P: Term, u: Term, y: Term, mask: Term,
    ) -> Results:  # fmt: skip
        # 1. Linearise at x_i: the gain is P H' S^-1, and x_next = x_prior + P w_next.
        Pw = times_transposed(P, w.T)
        H, e, R = measure(x + Pw, u, y, mask)
        S = congruence(H, P, R)
        w_next = turned_product(H, solve_definite(S, e + matrix_product(H, Pw)))
        by = times_transposed(P, (w_next - w).T)
        length = ca.sqrt(ca.fmax(inner_product(w_next - w, by), 0))

        # 2. Take the step if it is the first, or does not raise the cost; else halve it.
        w_try = w + t * (w_next - w)
        Pw_try = times_transposed(P, w_try.T)
        _, e_try, R = measure(x + Pw_try, u, y, mask)
        of_outputs = inner_product(e_try, solve_definite(R, e_try))
        J_try = (of_outputs + inner_product(w_try, Pw_try)) / 2
        found = named_results(judge, go, w, w_last, J, t, w_try, J_try, length)
        return {f"{name}_after": value for name, value in found.items()}

    sizes = {"go": 1, "w": nx, "J": 1, "t": 1}
    return half("iekf_step", s, formula, sizes)


def _judge(s: Setting, tolerance: float) -> ca.Function:
    """Take a step, or halve it; see `_step`."""

    def formula(
        go: ca.SX, w: ca.SX, w_last: ca.SX, J: ca.SX, t: ca.SX,
        w_try: ca.SX, J_try: ca.SX, length: ca.SX,
    ) -> Results:  # fmt: skip
        # The last step is shorter than what the cost resolves: rounding must not decide.
        more = length > tolerance
        better = J_try <= (1 + ROUNDING) * J
        good = ca.logic_or(ca.logic_or(J >= UNKNOWN, better), ca.logic_not(more))
        return {
            "go": more if tolerance > 0 else go,
            "w": ca.if_else(good, w_try, w),
            "w_last": ca.if_else(good, w, w_last),
            "J": ca.if_else(good, J_try, J),
            "t": ca.if_else(good, 1, t / 2),
        }

    sizes = {"go": 1, "w": s.model.nx, "J": 1, "t": 1, "length": 1}
    return leaf("judge", sizes, formula)


def _measurement(s: Setting) -> ca.Function:
    """Jacobian, residual and covariance of the measured rows, ``(x, u, y, mask) -> (H, e, R)``."""
    if Covariance(s.model.nx).whole and not s.parts:
        return _measurement_of_many(s)

    def formula(x: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        y_hat = s.model.output(x, u)
        H, e, R = masked(ca.jacobian(y_hat, x), y - y_hat, s.R_at(u), mask)
        return {"H": H, "e": e, "noise": R}

    return leaf("measurement", notation(s), formula)


def _measurement_of_many(s: Setting) -> ca.Function:
    """The same of many states, as operations on matrices."""
    nx, nu, ny = s.model.nx, s.model.nu, s.model.ny
    x, u, y, mask = given = [
        ca.MX.sym(k, n) for k, n in (("x", nx), ("u", nu), ("y", ny), ("mask", ny))
    ]
    y_hat, H = seen_outputs(s)(x, u)
    results = [scaled_rows(all_entries(H), mask), mask * (y - y_hat), noise_seen(s)(mask)]
    return ca.Function("measurement_of_many", given, results)


def _moved(s: Setting) -> ca.Function:
    """``(x_prior, P, w) -> x_prior + P w``."""

    def formula(x: Term, P: Term, w: Term) -> Results:
        return {"x_moved": x + times_transposed(P, w.T)}

    return half("moved_by_weights", s, formula, {"w": s.model.nx})


def _pivot(P: Term) -> Results:
    """Smallest pivot of a covariance; of many states the smallest variance."""
    return {"pivot": ca.mmin(ca.diag(P)) if isinstance(P, ca.MX) else smallest_pivot(P)}


def _finished(s: Setting, tolerance: float) -> ca.Function:
    """Keep the bounds and say what happened: ``(x, go, flags, pivot of P) -> (x, flags)``."""

    def formula(x: ca.SX, go: ca.SX, flags: ca.SX, pivot: ca.SX) -> Results:
        inside, known = within_bounds(s, x), Flags.of(flags)
        raised = dataclasses.replace(
            known,
            not_positive_definite=ca.if_else(pivot < NEGATIVE, 1, known.not_positive_definite),
            clipped=ca.if_else(ca.norm_1(inside - x) > 0, 1, 0),
            iteration_limit=go if tolerance > 0 else 0,
        )
        return {"x_inside": inside, "flags": raised.vector()}

    return leaf("finished", {**notation(s), "go": 1, "pivot": 1}, formula)
