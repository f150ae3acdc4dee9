"""Iterated extended Kalman filter."""

import dataclasses
from typing import ClassVar

import casadi as ca

from backsight.algebra.factor import solve_spd
from backsight.algebra.symmetric import unvech
from backsight.algebra.update import gain, masked
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import iterate
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator, Setting, setting
from backsight.estimators.kalman.ekf import halves
from backsight.estimators.parts.filtering import Halves, assemble
from backsight.estimators.parts.gaussian import FLAGS, clip
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Status

UNKNOWN = 1e300
"""Cost before the first step."""

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
    EKF with the Jacobian of the last linearisation; prediction is that of the EKF.

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
    """

    key: ClassVar[str] = "iekf"
    title: ClassVar[str] = "Iterated extended Kalman filter"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    integrator: Integrator = dataclasses.field(default_factory=Integrator)
    covariance: str = "transition"
    max_iterations: int = 10
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if self.max_iterations < 1:
            raise TuningError(f"max_iterations is {self.max_iterations}; it must be at least 1")
        if not self.tolerance >= 0:
            raise TuningError(f"tolerance is {self.tolerance}; it must not be negative")

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        s = setting(model, dt, noise=self.noise, prior=self.prior)
        once = halves(s, self.integrator, self.covariance)
        correct = _correct(s, once, self.max_iterations, self.tolerance)
        return assemble(self.key, s, dataclasses.replace(once, correct=correct))


def _correct(s: Setting, once: Halves, limit: int, tolerance: float) -> ca.Function:
    """Iterated measurement update, ``(x, spread, u, y, mask) -> (x, spread, flags)``.

    Estimates are x = x_prior + P w, so that P is never inverted and may be singular.
    """
    nx, correct = s.model.nx, once.correct
    given = [ca.MX.sym(correct.name_in(i), *correct.size_in(i)) for i in range(correct.n_in())]
    x_prior, spread, *_ = given
    start = [ca.MX(1), ca.MX.zeros(nx), ca.MX.zeros(nx), ca.MX(UNKNOWN), ca.MX(1)]
    step = _step(s, spread.numel(), tolerance)
    go, w, w_last, *_ = iterate(step, limit, carry=start, constants=given)
    # P as the EKF has it that linearises where the last step began.
    _, spread_post, flags = correct(_moved(s, spread.numel())(x_prior, spread, w_last), *given[1:])
    x_post, raised = _finished(s, spread.numel(), tolerance)(x_prior, spread, w, go, flags)
    return ca.Function("iterated_correct", given, [x_post, spread_post, raised])


def _step(s: Setting, n_spread: int, tolerance: float) -> ca.Function:
    """One Gauss-Newton step, ``(go, w, w_last, J, t, ...) -> (go, w, w_last, J, t)``.

    J is the cost at w, t the share of the step that is tried, w_last is where the step to w began.
    """
    go, J, t = (ca.SX.sym(n) for n in ("go", "J", "t"))
    w, w_last, x_prior = (ca.SX.sym(n, s.model.nx) for n in ("w", "w_last", "x"))
    spread, u = ca.SX.sym("P", n_spread), ca.SX.sym("u", s.model.nu)
    y, mask = ca.SX.sym("y", s.model.ny), ca.SX.sym("mask", s.model.ny)
    P, measurement = _full(s, spread), _measurement(s)

    # 1. Linearise at x_i: the gain is P H' S^-1, and x_next = x_prior + P w_next.
    H, e, R = measurement(x_prior + P @ w, u, y, mask)
    _, S = gain(P, H, R)
    w_next = H.T @ solve_spd(S, e + H @ (P @ w))
    length = ca.sqrt(ca.fmax(ca.dot(w_next - w, P @ (w_next - w)), 0))

    # 2. Take the step if it is the first, or does not raise the cost; else halve it.
    w_try = w + t * (w_next - w)
    _, e_try, R = measurement(x_prior + P @ w_try, u, y, mask)
    J_try = (ca.dot(e_try, solve_spd(R, e_try)) + ca.dot(w_try, P @ w_try)) / 2
    good = ca.logic_or(J >= UNKNOWN, J_try <= (1 + ROUNDING) * J)
    after = [
        length > tolerance if tolerance > 0 else go,
        ca.if_else(good, w_try, w),
        ca.if_else(good, w, w_last),
        ca.if_else(good, J_try, J),
        ca.if_else(good, 1, t / 2),
    ]
    return ca.Function("iekf_step", [go, w, w_last, J, t, x_prior, spread, u, y, mask], after)


def _measurement(s: Setting) -> ca.Function:
    """Jacobian, residual and covariance of the measured rows, ``(x, u, y, mask) -> (H, e, R)``."""
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    y, mask = ca.SX.sym("y", s.model.ny), ca.SX.sym("mask", s.model.ny)
    y_hat = s.model.output(x, u)
    rows = masked(ca.jacobian(y_hat, x), y - y_hat, ca.SX(s.R), mask)
    return ca.Function("measurement", [x, u, y, mask], rows)


def _moved(s: Setting, n_spread: int) -> ca.Function:
    """``(x_prior, spread, w) -> x_prior + P w``."""
    x, w = ca.SX.sym("x", s.model.nx), ca.SX.sym("w", s.model.nx)
    spread = ca.SX.sym("P", n_spread)
    return ca.Function("moved", [x, spread, w], [x + _full(s, spread) @ w])


def _finished(s: Setting, n_spread: int, tolerance: float) -> ca.Function:
    """Keep the bounds and say what happened: ``(x_prior, spread, w, go, flags) -> (x, flags)``."""
    x, w, spread, go, flags = (
        ca.SX.sym(n, k)
        for n, k in (("x", s.model.nx), ("w", s.model.nx), ("P", n_spread), ("go", 1), ("f", 4))
    )
    free = _moved(s, n_spread)(x, spread, w)
    x_post = clip(s, free)
    raised = {
        Status.CLIPPED: ca.if_else(ca.norm_1(x_post - free) > 0, 1, 0),
        Status.ITERATION_LIMIT: go if tolerance > 0 else ca.SX(0),
    }
    marks = [raised.get(status, flags[i]) for i, status in enumerate(FLAGS)]
    return ca.Function("finished", [x, spread, w, go, flags], [x_post, ca.vertcat(*marks)])


def _full(s: Setting, spread: ca.SX) -> ca.SX:
    """P (nx, nx) of what the EKF keeps of it."""
    n = s.model.nx
    return ca.reshape(spread, n, n) if spread.numel() == n * n and n > 1 else unvech(spread)
