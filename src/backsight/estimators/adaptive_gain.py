r"""Gain of the observer that follows the innovation, eq. 17-19.

Source: Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
estimation: a comparison to extended and unscented Kalman filter"; Boizot, Busvelle, Gauthier (2010),
doi:10.1016/j.automatica.2010.06.004.
"""

import dataclasses

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import iterate, scan
from backsight.errors import TuningError
from backsight.models.affine import AffineForm


@dataclasses.dataclass(frozen=True)
class AdaptiveGain:
    r"""High gain while the model does not explain the output, low gain otherwise.

    .. math::
        \dot\lambda = K_{up} S (\lambda_{max} - \lambda)
          + K_{down} (1 - S) (\lambda_{min} - \lambda), \qquad \lambda(0) = \lambda_{max}

        S = \frac{1}{1 + e^{-\beta (I - \gamma)}}, \qquad
        I = \int_{t-T}^{t} |y(s) - \bar y(s)| \, ds

    where :math:`\bar y` is the model's response from the estimates at t - T. The printed S has the
    sign of the exponential wrong (it is singular at :math:`I = \gamma`). Between evaluations S is
    constant and lambda is integrated exactly.

    Parameters
    ----------
    lower : float
        lambda_min [1/s]; the observer's `lam` is lambda_max.
    gamma : float
        Innovation at which the gain switches [output unit * s]. It must exceed the innovation that
        noise alone causes at lambda_max, see `backsight.tune.propose_threshold`.
    beta : float
        Sharpness [1/(output unit * s)].
    window : float
        T [s].
    every : float
        Time between evaluations [s]; the window is a multiple of it.
    up, down : float
        K_up and K_down [1/s].
    """

    lower: float
    gamma: float
    beta: float
    window: float = 0.04
    every: float = 0.001
    up: float = 500.0
    down: float = 5.0

    def __post_init__(self) -> None:
        for name in ("lower", "gamma", "beta", "window", "every", "up", "down"):
            if not getattr(self, name) > 0:
                raise TuningError(f"adaptive gain: {name} is {getattr(self, name)}; it must be > 0")
        if not self.window >= self.every:
            raise TuningError("adaptive gain: the window is shorter than the time between checks")

    def lengths(self, dt: float) -> tuple[int, int]:
        """Samples between evaluations and evaluations per window."""
        stride = max(1, round(self.every / dt))
        return stride, max(1, round(self.window / (stride * dt)))

    def sigmoid(self, innovation: ca.SX) -> ca.SX:
        """S of eq. 19, with the sign corrected."""
        return 1 / (1 + ca.exp(-self.beta * (innovation - self.gamma)))


def gain_step(gain: AdaptiveGain, upper: float, dt: float) -> ca.Function:
    """Exact solution of eq. 17 over one sample for constant S: ``(lam, S) -> lam``."""
    lam, S = ca.SX.sym("lam"), ca.SX.sym("S")
    rise, fall = gain.up * S, gain.down * (1 - S)
    rate = rise + fall
    rest = (rise * upper + fall * gain.lower) / rate
    return ca.Function("gain_step", [lam, S], [rest + (lam - rest) * ca.exp(-rate * dt)])


def evaluation(
    form: AffineForm, gain: AdaptiveGain, integrator: Integrator, dt: float
) -> ca.Function:
    """Evaluate S where it is due, else keep it.

    ``(due, S, count, history, x, theta, U, Y, M) -> (S, count, history)``: the history holds the
    estimates at the evaluations of the window, oldest first; U, Y and M the samples of the window,
    both ends included. Before the window is full S stays as it is.
    """
    stride, evaluations = gain.lengths(dt)
    n, p, nu = form.n, len(form.combinations), form.phi.numel_in(1)
    samples = stride * evaluations
    due, S, count = ca.MX.sym("due"), ca.MX.sym("S"), ca.MX.sym("count")
    history = ca.MX.sym("history", n + p, evaluations)
    x, theta = ca.MX.sym("x", n), ca.MX.sym("theta", p)
    U, Y, M = (ca.MX.sym(k, m, samples + 1) for k, m in (("U", nu), ("Y", 1), ("M", 1)))

    oldest = history[:, 0]
    (_, area), _ = scan(
        _prediction_error(form, integrator, dt),
        samples,
        carry=[oldest[:n], ca.MX(0)],
        xs=[U[:, :-1], U[:, 1:], Y[:, :-1], Y[:, 1:], M[:, :-1], M[:, 1:]],
        constants=[oldest[n:]],
    )
    a, s, k = ca.SX.sym("a"), ca.SX.sym("s"), ca.SX.sym("k")
    full = k >= evaluations
    decide = ca.Function("decide", [a, s, k], [ca.if_else(full, gain.sigmoid(a), s), k + 1])
    S_new, count_new = decide(area, S, count)
    history_new = ca.horzcat(history[:, 1:], ca.vertcat(x, theta))
    constants = [x, theta, U, Y, M]
    body = ca.Function(
        "evaluate_gain",
        [due, S, count, history, *constants],
        [ca.MX(0), S_new, count_new, history_new],
    )
    once = iterate(body, 1, carry=[due, S, count, history], constants=constants)
    return ca.Function("evaluation", [due, S, count, history, *constants], once[1:])


def _prediction_error(form: AffineForm, integrator: Integrator, dt: float) -> ca.Function:
    """One sample of the model from fixed estimates, and the area |y - y_bar| by trapezoids."""
    n, p, nu = form.n, len(form.combinations), form.phi.numel_in(1)
    x, area, theta = ca.SX.sym("x", n), ca.SX.sym("area"), ca.SX.sym("theta", p)
    ua, ub = ca.SX.sym("ua", nu), ca.SX.sym("ub", nu)
    ya, yb, ma, mb = (ca.SX.sym(k) for k in ("ya", "yb", "ma", "mb"))
    rhs = chain_rhs(form)
    x_next = integrator.substep(lambda v, w: rhs.call([v, theta, w])[0], x, ua=ua, ub=ub, h=dt)
    added = dt / 2 * (ma * ca.fabs(ya - x[0]) + mb * ca.fabs(yb - x_next[0]))
    return ca.Function(
        "prediction_error",
        [x, area, ua, ub, ya, yb, ma, mb, theta],
        [x_next, area + added],
    )


def chain_rhs(form: AffineForm) -> ca.Function:
    """Right-hand side of eq. 6: ``(x, theta, u) -> dx``."""
    n, p = form.n, len(form.combinations)
    x, theta = ca.SX.sym("x", n), ca.SX.sym("theta", p)
    u = ca.SX.sym("u", form.phi.numel_in(1))
    driven = ca.dot(form.psi.call([x, u])[0], theta) if p else ca.SX(0)
    dx = ca.vertcat(x[1:], 0) + form.phi.call([x, u])[0]
    dx[n - 1] += driven
    return ca.Function("chain_rhs", [x, theta, u], [dx])


def start(gain: AdaptiveGain, form: AffineForm, dt: float) -> dict[str, np.ndarray]:
    """Memory of the adaptive gain before the first sample."""
    stride, evaluations = gain.lengths(dt)
    samples, size = stride * evaluations + 1, form.n + len(form.combinations)
    return {
        "S": np.ones(1),
        "evaluated": np.zeros(1),
        "elapsed": np.zeros(1),
        "history": np.zeros(size * evaluations),
        "U": np.zeros(form.phi.numel_in(1) * samples),
        "Y": np.zeros(samples),
        "M": np.zeros(samples),
    }
