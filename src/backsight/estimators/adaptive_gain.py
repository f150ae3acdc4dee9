r"""Gain of the observer that follows the innovation, eq. 17-19.

Source: Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
estimation: a comparison to extended and unscented Kalman filter"; Boizot, Busvelle, Gauthier, "An
adaptive high-gain observer for nonlinear systems", Automatica 46 (2010), 1483-1488.
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
    n, p, nu = form.n, form.p, form.nu
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


def adapt(
    gain: AdaptiveGain,
    form: AffineForm,
    integrator: Integrator,
    *,
    upper: float,
    dt: float,
    memory: list[ca.MX],
    data: tuple[ca.MX, ca.MX, ca.MX],
    estimate: tuple[ca.MX, ca.MX, ca.MX],
) -> tuple[list[ca.MX], ca.MX]:
    """Memory of the gain after this sample, and lambda of the next one.

    Parameters
    ----------
    gain, form, integrator
        The integrator's `hold` is that of the input.
    upper, dt : float
        lambda_max [1/s] and sampling period [s].
    memory : list of MX
        As from `start`, one symbol for each entry.
    data, estimate : tuple of MX
        u, y, mask and x, theta, lambda of this sample.
    """
    x, theta, lam = estimate
    stride, evaluations = gain.lengths(dt)
    samples = stride * evaluations + 1
    S, evaluated, elapsed, history, *windows = memory
    history = ca.reshape(history, form.n + form.p, evaluations)
    U, Y, M = (
        ca.horzcat(ca.reshape(w, d.numel(), samples)[:, 1:], d)
        for w, d in zip(windows, data, strict=True)
    )
    due, elapsed = _clock(stride)(elapsed)
    S, evaluated, history = evaluation(form, gain, integrator, dt)(
        due, S, evaluated, history, x, theta, U, Y, M
    )
    lam = gain_step(gain, upper, dt)(lam, S)
    return [ca.vec(m) for m in (S, evaluated, elapsed, history, U, Y, M)], lam


def _clock(stride: int) -> ca.Function:
    """``elapsed -> (due, elapsed)``: due at the first sample and every `stride` samples."""
    elapsed = ca.SX.sym("elapsed")
    following = ca.if_else(elapsed + 1 >= stride, 0, elapsed + 1)
    return ca.Function("clock", [elapsed], [ca.if_else(elapsed > 0, 0, 1), following])


def _prediction_error(form: AffineForm, integrator: Integrator, dt: float) -> ca.Function:
    """One sample of the model from fixed estimates, and the area |y - y_bar| by trapezoids."""
    x, area = ca.SX.sym("x", form.n), ca.SX.sym("area")
    theta, ua, ub = (ca.SX.sym(k, m) for k, m in (("t", form.p), ("ua", form.nu), ("ub", form.nu)))
    ya, yb, ma, mb = (ca.SX.sym(k) for k in ("ya", "yb", "ma", "mb"))
    x_next = integrator.substep(lambda v, w: form.rhs(v, theta, w), x, ua=ua, ub=ub, h=dt)
    added = dt / 2 * (ma * ca.fabs(ya - x[0]) + mb * ca.fabs(yb - x_next[0]))
    return ca.Function(
        "prediction_error",
        [x, area, ua, ub, ya, yb, ma, mb, theta],
        [x_next, area + added],
    )


def start(gain: AdaptiveGain, form: AffineForm, dt: float) -> dict[str, np.ndarray]:
    """Memory of the adaptive gain before the first sample."""
    stride, evaluations = gain.lengths(dt)
    samples, size = stride * evaluations + 1, form.n + form.p
    return {
        "S": np.ones(1),
        "evaluated": np.zeros(1),
        "elapsed": np.zeros(1),
        "history": np.zeros(size * evaluations),
        "U": np.zeros(form.nu * samples),
        "Y": np.zeros(samples),
        "M": np.zeros(samples),
    }
