"""Moving horizon estimation for linear models: least squares over a window."""

import dataclasses
import numbers
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.engine.dense import add_product
from backsight.engine.loops import iterate, scan
from backsight.engine.recursion import Recursion
from backsight.errors import TuningError
from backsight.estimators import gaussian
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Setting
from backsight.estimators.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.linear import Linear, linear, predict
from backsight.estimators.stacked import Gains, gains
from backsight.estimators.uncertainty import Noise, Prior
from backsight.estimators.window_filter import window_filter
from backsight.models.model import Model
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class LinearMHE(AbstractEstimator):
    r"""Least-squares moving horizon estimator.

    At every sample k it finds the trajectory :math:`x_{i+1} = A x_i + B u_i + w_i` through the
    window k - N ... k that minimises

    .. math:: a\,(x_{k-N} - \bar x)' \bar P^{-1} (x_{k-N} - \bar x)
        + \sum_{i=k-N}^{k-1} w_i' Q^{-1} w_i + \sum_{i=k-N}^{k} v_i' R^{-1} v_i,
        \qquad v_i = y_i - C x_i - D u_i,

    and puts out its end. Directions without process noise are exact in the model (Q may be
    singular or zero; it is never inverted). With a = 0 nothing from before the window counts.
    With Q = 0, too, it is the batch estimator of the lectures, :math:`\hat x_k = M Y + N_u U`;
    with a = 1 it is the Kalman filter.

    Parameters
    ----------
    noise : Noise
    prior : Prior
        Used until the window is full.
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    arrival : float
        Weight a of what is known from before the window: :math:`\bar x, \bar P` are the
        prediction of a Kalman filter for the first sample of the window.
    hold : {"zoh", "foh"}
        Input between the samples of a continuous model: held, or interpolated.

    Notes
    -----
    Missing samples are left out. If those that remain do not determine the state, the arrival
    cost is used with its full weight for this sample and the status says *unobserved*.

    References
    ----------
    Ling, Lim, "Receding horizon recursive state estimation", 1999, doi:10.1109/9.788546.
    Rao, Rawlings, Lee, "Constrained linear state estimation: a moving horizon approach", 2001,
    doi:10.1016/S0005-1098(01)00115-7.
    """

    key: ClassVar[str] = "lmhe"
    title: ClassVar[str] = "Least-squares moving horizon estimator"

    noise: Noise
    prior: Prior
    N: int = 20
    arrival: float = 0.0
    hold: str = "zoh"

    def __post_init__(self) -> None:
        if not isinstance(self.N, numbers.Integral) or self.N < 1:
            raise TuningError(f"the horizon N is {self.N}; it must be a whole number from 1 on")
        if not 0 <= self.arrival <= 1:
            raise TuningError(f"the weight arrival is {self.arrival}; it must be from 0 to 1")

    def gains(self, model: Model, dt: float) -> Gains:
        """Gains of a full window, physical units, see `Gains`."""
        system = self._system(model, dt)
        s, scaled = system.s, gains(system, self.N)
        return Gains(
            M=scaled.M * s.sx[:, None] / np.tile(s.sy, self.N + 1),
            N_u=scaled.N_u * s.sx[:, None] / np.tile(s.su, self.N + 1),
            P=scaled.P * np.outer(s.sx, s.sx),
        )

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        system = self._system(model, dt)
        s, N = system.s, self.N
        fixed = gains(system, N)
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        memory = {
            "x_start": s.x0,
            "P_start": packed(s.P0),
            "x_last": s.x0,
            "P_last": packed(s.P0),
            "U": np.zeros(s.model.nu * (N + 1)),
            "Y": np.zeros(s.model.ny * (N + 1)),
            "M": np.zeros(s.model.ny * (N + 1)),
            "present": np.zeros(N + 1),
        }
        symbol, (x_start, P_start, x_last, P_last, *windows) = carry_inputs(list(memory.values()))
        U, Y, M, present = (ca.reshape(w, w.numel() // (N + 1), N + 1) for w in windows)

        time_update, free = predict(system), _without_bounds(s)
        last = [x_last, P_last]
        prior = choose(present[N], time_update.call([*last, U[:, N], u]), last)
        e, S = gaussian.innovation(s)(*prior, u, y, mask)
        corrected = gaussian.correct(free)(x_start, P_start, U[:, 0], Y[:, 0], M[:, 0])[:2]
        moved = time_update.call([*corrected, U[:, 0], U[:, 1]])
        x_start, P_start = choose(present[0], moved, [x_start, P_start])
        U, Y, M, present = (
            ca.horzcat(w[:, 1:], new) for w, new in ((U, u), (Y, y), (M, mask), (present, 1))
        )

        go, diffuse, P_lead = _plan(s, self.arrival)(_all(M), present[0], P_start)
        by_gains = _product(fixed.M, ca.vec(Y)) + _product(fixed.N_u, ca.vec(U))
        _, _, lacking, x, P = iterate(
            _pass(system, N),
            2,
            carry=[go, diffuse, ca.MX(0), by_gains, ca.MX(packed(fixed.P))],
            constants=[x_start, P_lead, P_start, U, Y, M, present],
        )
        carry = [x_start, P_start, x, P, *(ca.vec(w) for w in (U, Y, M, present))]
        outputs = physical(s, (Status.UNOBSERVED,))(x, P, u, e, S, lacking)
        return Recursion(
            step=ca.Function(self.key, [symbol, *data], [ca.vertcat(*carry), *outputs]),
            carry0=np.concatenate(list(memory.values())),
            channels=ESTIMATE_CHANNELS,
            dt=dt,
        )

    def _system(self, model: Model, dt: float) -> Linear:
        return linear(model, dt, noise=self.noise, prior=self.prior, hold=self.hold)


def _without_bounds(s: Setting) -> Setting:
    free = [dataclasses.replace(x, lower=-np.inf, upper=np.inf) for x in s.model.states]
    return dataclasses.replace(s, model=dataclasses.replace(s.model, states=tuple(free)))


def _product(matrix: Array, vector: ca.MX) -> ca.MX:
    """Constant matrix times vector, as a loop."""
    rows = len(matrix)
    return ca.vec(add_product(ca.MX.zeros(1, rows), vector.T, ca.MX(ca.DM(matrix))))


def _all(M: ca.MX) -> ca.MX:
    """1 if every sample of the window was measured."""
    ny, n = M.shape
    so_far, mask = ca.SX.sym("so_far"), ca.SX.sym("mask", ny)
    body = ca.Function("all", [so_far, mask], [ca.fmin(so_far, ca.mmin(mask))])
    return scan(body, n, carry=[ca.MX(1)], xs=[M])[0][0]


def _plan(s: Setting, arrival: float) -> ca.Function:
    """Whether to go through the window, whether its start is unknown, and its covariance."""
    measured, full = ca.SX.sym("measured"), ca.SX.sym("full")
    P = ca.SX.sym("P", len(packed(s.P0)))
    if arrival == 0:
        plan = [1 - full * measured, full, P]
    else:
        plan = [ca.SX(1), ca.SX(0), P / ca.if_else(full, arrival, 1)]
    return ca.Function("plan", [measured, full, P], plan)


def _pass(system: Linear, N: int) -> ca.Function:
    """Go through the window; where nothing is known of its start, but must be, once more."""
    through = window_filter(system, N)
    start = [ca.MX.sym(through.name_in(i), *through.size_in(i)) for i in range(through.n_in())]
    x_start, P_lead, diffuse, *window = start
    P_start = ca.MX.sym("P_start", P_lead.numel())
    go, lacking = ca.MX.sym("go"), ca.MX.sym("lacking")
    (P,) = choose(lacking, [P_start], [P_lead])
    x_now, P_now, deficient = through(x_start, P, diffuse, *window)
    (lacks,) = choose(deficient, [ca.MX(1)], [lacking])
    ignored = [ca.MX.sym("x", x_now.numel()), ca.MX.sym("P_now", P_now.numel())]
    return ca.Function(
        "pass",
        [go, diffuse, lacking, *ignored, x_start, P_lead, P_start, *window],
        [deficient, ca.MX(0), lacks, x_now, P_now],
    )
