r"""Gain of the observer that follows the innovation, eq. 17-19.

Source: Riva, Dagen, Ortmaier, "Adaptive high-gain observer for joint state and parameter
estimation: a comparison to extended and unscented Kalman filter"; Boizot, Busvelle, Gauthier, "An
adaptive high-gain observer for nonlinear systems", Automatica 46 (2010), 1483-1488.
"""

import dataclasses
from collections.abc import Iterator
from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from backsight.description import Description, Positive, Sound
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import iterate, scan
from backsight.estimators.observers._formulas import observer_sizes
from backsight.estimators.parts.leaf import Results, leaf
from backsight.models.canonical.affine import AffineForm
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class AdaptiveGain(Description):
    r"""High gain while the model does not explain the output, low gain otherwise.

    .. math::
        \dot\lambda = K_{up} S (\lambda_{max} - \lambda)
          + K_{down} (1 - S) (\lambda_{min} - \lambda), \qquad \lambda(0) = \lambda_{max}

        S = \frac{1}{1 + e^{-\beta (I - \gamma)}}, \qquad
        I = \int_{t-T}^{t} |y(s) - \bar y(s)| \, ds

    where :math:`\bar y` is the model's response from the estimates at t - T. The printed S has the
    sign of the exponential wrong (it is singular at :math:`I = \gamma`). With ``switch="hard"`` S
    is that of eq. 18, 1 where :math:`I \ge \gamma` and else 0. Between evaluations S is constant
    and lambda is integrated exactly.

    Parameters
    ----------
    lower : float
        lambda_min [1/s]; the observer's `lam` is lambda_max.
    gamma : float
        Innovation at which the gain switches [output unit * s]. It must exceed the innovation that
        noise alone causes at lambda_max, see `backsight.tune.propose_threshold`.
    beta : float, optional
        Sharpness [1/(output unit * s)]; 20 / gamma if not given, so that S is next to nothing
        without innovation.
    window : float
        T [s].
    every : float
        Time between evaluations [s]; the window is a multiple of it.
    up, down : float
        K_up and K_down [1/s].
    switch : {"smooth", "hard"}
        S of eq. 19, or the abrupt one of eq. 18, which has no beta.

    Examples
    --------
    >>> bs.settings.AdaptiveGain(lower=10.0, gamma=5.0).lower
    10.0
    """

    called: ClassVar[str] = "adaptive gain"

    lower: Positive
    gamma: Positive
    beta: Positive | None = None
    window: Positive = 0.04
    every: Positive = 0.001
    up: Positive = 500.0
    down: Positive = 5.0
    switch: Literal["smooth", "hard"] = "smooth"

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("window", "every") and not self.window >= self.every:
            yield (
                f"the window ({self.window:g} s) is shorter than the time between "
                f"evaluations ({self.every:g} s)"
            )
        if sound("switch", "beta") and self.switch == "hard" and self.beta is not None:
            yield f"beta = {self.beta:g} is the sharpness of the smooth switch; leave it out"

    def lengths(self, dt: float) -> tuple[int, int]:
        """Samples between evaluations and evaluations per window."""
        stride = max(1, round(self.every / dt))
        return stride, max(1, round(self.window / (stride * dt)))

    def samples(self, dt: float) -> int:
        """Samples of a window, both ends included."""
        stride, evaluations = self.lengths(dt)
        return stride * evaluations + 1

    def sigmoid(self, innovation: ca.SX) -> ca.SX:
        """S of eq. 19, with the sign corrected, or of eq. 18."""
        if self.switch == "hard":
            return ca.if_else(innovation >= self.gamma, 1, 0)
        beta = 20 / self.gamma if self.beta is None else self.beta
        return 1 / (1 + ca.exp(-beta * (innovation - self.gamma)))


def gain_step(gain: AdaptiveGain, upper: float, dt: float) -> ca.Function:
    """Exact solution of eq. 17 over one sample for constant S: ``(lam, S) -> lam``."""

    def formula(lam: ca.SX, S: ca.SX) -> Results:
        rise, fall = gain.up * S, gain.down * (1 - S)
        rate = rise + fall
        rest = (rise * upper + fall * gain.lower) / rate
        return {"lam": rest + (lam - rest) * ca.exp(-rate * dt)}

    return leaf("gain_step", {"lam": 1, "S": 1}, formula)


def adapt(
    gain: AdaptiveGain,
    form: AffineForm,
    integrator: Integrator,
    *,
    upper: float,
    dt: float,
    memory: dict[str, ca.MX],
    last: tuple[ca.MX, ca.MX, ca.MX],
    data: tuple[ca.MX, ca.MX, ca.MX],
    estimate: tuple[ca.MX, ca.MX, ca.MX],
) -> dict[str, ca.MX]:
    """Memory of the gain after this sample, with lambda of the next one.

    Every evaluation needs the response from the estimates one window ago. The responses of all
    coming evaluations are therefore under way at the same time, each a step further with every
    sample: the work per sample is the same always, and no sample has to be remembered.

    Parameters
    ----------
    gain, form, integrator
        The integrator's `hold` is that of the input.
    upper, dt : float
        lambda_max [1/s] and sampling period [s].
    memory : dict
        As from `gain_start`, one symbol for each part.
    last, data : tuple of MX
        u, y, mask of the last sample and of this one.
    estimate : tuple of MX
        x, theta, lambda of this sample.
    """
    x, theta, lam = estimate
    stride, count = gain.lengths(dt)
    columns = [memory["X"], memory["areas"], memory["T"]]
    ends = [end for pair in zip(last, data, strict=True) for end in pair]
    step = prediction_error(form, integrator, dt)
    _, (X, areas) = scan(step, count, carry=[], xs=columns, constants=ends)
    due, elapsed = _clock(stride)(memory["elapsed"])
    state = {
        "S": memory["S"],
        "evaluated": memory["evaluated"],
        "X": ca.vec(X),
        "T": ca.vec(memory["T"]),
        "areas": ca.vec(areas),
    }
    turn = _turn(form, gain, count)
    _, *turned = iterate(turn, 1, carry=[due, *state.values()], constants=[x, theta])
    after = dict(zip(state, turned, strict=True))
    lam_next = gain_step(gain, upper, dt)(lam, after["S"])
    shaped = {name: ca.reshape(after[name], *memory[name].shape) for name in state}
    return {**shaped, "elapsed": elapsed, "lam": lam_next}


def _turn(form: AffineForm, gain: AdaptiveGain, count: int) -> ca.Function:
    """Evaluate the oldest response and begin a new one.

    ``(due, S, evaluated, X, T, areas, x, theta)`` to the first six, oldest first; S stays as it is
    before the first window is full.
    """
    n, p = form.n, form.p

    def formula(  # `due` only says that there is a turn
        due: ca.SX,  # noqa: ARG001
        S: ca.SX, evaluated: ca.SX, X: ca.SX, T: ca.SX, areas: ca.SX,
        x: ca.SX, theta: ca.SX,
    ) -> Results:  # fmt: skip
        return {
            "due": ca.SX(0),
            "S": ca.if_else(evaluated >= count, gain.sigmoid(areas[0]), S),
            "evaluated": evaluated + 1,
            "X": ca.vertcat(X[n:], x),
            "T": ca.vertcat(T[p:], theta),
            "areas": ca.vertcat(areas[1:], 0),
        }

    columns = {"X": n * count, "T": p * count, "areas": count}
    sizes = {**observer_sizes(form), **columns, "due": 1, "S": 1, "evaluated": 1}
    return leaf("turn", sizes, formula)


def _clock(stride: int) -> ca.Function:
    """``elapsed -> (due, elapsed)``: due at the first sample and every `stride` samples."""

    def formula(elapsed: ca.SX) -> Results:
        following = ca.if_else(elapsed + 1 >= stride, 0, elapsed + 1)
        return {"due": ca.if_else(elapsed > 0, 0, 1), "elapsed": following}

    return leaf("clock", {"elapsed": 1}, formula)


def prediction_error(form: AffineForm, integrator: Integrator, dt: float) -> ca.Function:
    """One sample of the model from fixed estimates, and the area |y - y_bar| by trapezoids.

    ``(x, area, theta, ua, ub, ya, yb, ma, mb) -> (x, area)``.
    """

    def formula(
        x: ca.SX, area: ca.SX, theta: ca.SX, ua: ca.SX, ub: ca.SX,
        ya: ca.SX, yb: ca.SX, ma: ca.SX, mb: ca.SX,
    ) -> Results:  # fmt: skip
        x_next = integrator.substep(lambda v, w: form.rhs(v, theta, w), x, ua=ua, ub=ub, h=dt)
        added = dt / 2 * (ma * ca.fabs(ya - x[0]) + mb * ca.fabs(yb - x_next[0]))
        return {"x": x_next, "area": area + added}

    return leaf("prediction_error", observer_sizes(form), formula)


def window_innovation(
    form: AffineForm, integrator: Integrator, order: list[int], *, dt: float, length: int
) -> ca.Function:
    """Innovation of eq. 19, see `AbstractAdaptiveObserver.window_innovation`.

    Parameters
    ----------
    form, integrator
        As for `prediction_error`.
    order : list of int
        Which of the model's states are those of the form, and then its parameters.
    dt : float
    length : int
        Sampling periods of the window.
    """
    x_hat = ca.MX.sym("x_hat", len(order))
    U, Y, M = (ca.MX.sym(k, m, length + 1) for k, m in (("U", form.nu), ("Y", 1), ("M", 1)))
    ordered = x_hat[order]
    x, theta = ordered[: form.n], form.theta(ordered[form.n :])
    if form.coordinates is not None:
        x = form.coordinates.chain(x)
    ends = (part for d in (U, Y, M) for part in (d[:, :-1], d[:, 1:]))
    (_, area), _ = scan(
        prediction_error(form, integrator, dt),
        length,
        carry=[x, ca.MX(0)],
        xs=[ca.repmat(theta, 1, length), *ends],
    )
    return ca.Function("window_innovation", [x_hat, U, Y, M], [area])


def gain_start(gain: AdaptiveGain, dt: float, *, x0: Array, theta0: Array) -> dict[str, Array]:
    """Memory of the adaptive gain before the first sample."""
    _, count = gain.lengths(dt)
    return {
        "S": np.ones(1),
        "evaluated": np.zeros(1),
        "elapsed": np.zeros(1),
        "X": np.tile(x0[:, None], count),
        "T": np.tile(theta0[:, None], count),
        "areas": np.zeros((1, count)),
    }
