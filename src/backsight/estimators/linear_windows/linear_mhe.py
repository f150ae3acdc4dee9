"""Moving horizon estimation for linear models: least squares over a window."""

import dataclasses
import numbers
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.engine.loops import iterate, scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Setting
from backsight.estimators.linear_windows._impose import RAISED, impose
from backsight.estimators.linear_windows._window_filter import window_filter
from backsight.estimators.linear_windows.stacked import Gains, gains, in_units, product
from backsight.estimators.linear_windows.window_limits import limit_gains, window_limits
from backsight.estimators.parts import gaussian
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.parts.limits import Limit, Rows, bounds, rows_of
from backsight.estimators.parts.linear import (
    Linear,
    linear,
    predict_packed,
    require_observable,
    without_bounds,
)
from backsight.estimators.parts.window import advance, as_columns, empty_window
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations, Status


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
    limits : tuple of Limit
        Bounds at every sample of the window, beside those of the states in the model.

    Notes
    -----
    Limits are imposed by an exact active set method on the optimal solution without them; inactive
    ones change nothing. If they contradict each other, the estimate is the one without limits, the
    status says *infeasible*, and the output ``infeasible`` names them. In P the active limits count
    as exact measurements: directions that they fix have no variance.

    Missing samples are left out. If those that remain do not determine the state, the arrival
    cost is used with its full weight for this sample and the status says *unobserved*.

    References
    ----------
    Ling, Lim, "Receding horizon recursive state estimation", IEEE Transactions on Automatic
    Control, 1999.
    Rao, Rawlings, Lee, "Constrained linear state estimation: a moving horizon approach", 2001,
    Automatica 37(10).
    """

    key: ClassVar[str] = "lmhe"
    title: ClassVar[str] = "Least-squares moving horizon estimator"
    weighs: ClassVar[bool] = True

    noise: Noise
    prior: Prior
    N: int = 20
    arrival: float = 0.0
    hold: str = "zoh"
    limits: tuple[Limit, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.N, numbers.Integral) or self.N < 1:
            raise TuningError(f"the horizon N is {self.N}; it must be a whole number from 1 on")
        if not 0 <= self.arrival <= 1:
            raise TuningError(f"the weight arrival is {self.arrival}; it must be from 0 to 1")

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white" if self.arrival == 1 else "coloured"

    def gains(self, model: Model, dt: float) -> Gains:
        """Gains of a full window without arrival cost, physical units, see `Gains`."""
        system = self._system(model, dt)
        require_observable(model, samples=self.N + 1)
        return in_units(gains(system, self.N), system.s)

    def compile(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.compile`."""
        system = self._system(model, dt)
        s, N = system.s, self.N
        if self.arrival == 0:
            require_observable(model, samples=N + 1)
        rows = rows_of(system, model, self.limits)
        n = len(rows.names)
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        memory = {
            "x_start": s.x0,
            "P_start": packed(s.P0),
            "x_last": s.x0,
            "P_last": packed(s.P0),
            **empty_window(s, N + 1),
            "present": np.zeros(N + 1),
            "active": np.zeros(n * (N + 1)),
        }
        symbol, (x_start, P_start, x_last, P_last, *windows, before) = carry_inputs(
            list(memory.values())
        )
        U, Y, M, present = as_columns(windows, N + 1)

        time_update, free = predict_packed(system), without_bounds(s)
        last = [x_last, P_last]
        prior = choose(present[N], time_update.call([*last, U[:, N], u]), last)
        e, S = gaussian.innovation(s)(*prior, u, y, mask)
        corrected = gaussian.correct(free)(x_start, P_start, U[:, 0], Y[:, 0], M[:, 0])[:2]
        moved = time_update.call([*corrected, U[:, 0], U[:, 1]])
        x_start, P_start = choose(present[0], moved, [x_start, P_start])
        U, Y, M, present = advance((U, Y, M, present), (u, y, mask, 1))

        window = (U, Y, M, present)
        lacking, x, P, *quantities = _solve(system, rows, N, self.arrival, x_start, P_start, window)
        flags, channels, named, active = [lacking], ESTIMATE_CHANNELS, [], before
        if n:
            limits = bounds(system, rows, N)(*window)
            x, P, active, conflict, raised = impose(s, n, N)(x, P, *quantities, *limits, before)
            flags.append(raised)
            named = [conflict]
            channels += (Channel("infeasible", ("limit",), labels=rows.names),)
        carry = [x_start, P_start, x, P, *map(ca.vec, window), active]
        meaning = (Status.UNOBSERVED, *(RAISED if n else ()))
        outputs = physical(s, meaning)(x, P, u, e, S, ca.vertcat(*flags))
        return Recursion(
            step=ca.Function(self.key, [symbol, *data], [ca.vertcat(*carry), *outputs, *named]),
            carry0=np.concatenate(list(memory.values())),
            channels=channels,
            dt=dt,
        )

    def _system(self, model: Model, dt: float) -> Linear:
        return linear(model, dt, noise=self.noise, prior=self.prior, hold=self.hold)


DEFICIENT = 2
"""Place of the flag among the results of `window_filter`."""


def _solve(
    system: Linear,
    rows: Rows,
    N: int,
    arrival: float,
    x_start: ca.MX,
    P_start: ca.MX,
    window: tuple[ca.MX, ...],
) -> list[ca.MX]:
    """Solve a window without its limits: 1 if its measurements do not suffice, x and P at its end.

    With limits also mean, covariance and covariance with x of the limited quantities. A full window
    without gaps is a product with constant gains; others are gone through sample by sample.
    """
    U, Y, M, present = window
    through = window_limits(system, rows, N) if rows.names else window_filter(system, N)
    go, diffuse, P_lead = _plan(system.s, arrival)(_all(M), present[0], P_start)
    results = [through.size_out(i) for i in range(through.n_out()) if i != DEFICIENT]
    found = [ca.MX.zeros(*size) for size in results]
    if arrival == 0:
        fixed = gains(system, N)
        by_gains = product(fixed.M, ca.vec(Y)) + product(fixed.N_u, ca.vec(U))
        found = [by_gains, ca.MX(packed(fixed.P))]
    if arrival == 0 and rows.names:
        kept = limit_gains(system, rows, N)
        found.append(product(kept.K, ca.vec(Y)) + product(kept.K_u, ca.vec(U)))
        found += [ca.MX(ca.DM(kept.M)), ca.MX(ca.DM(kept.Psi))]
    last = iterate(
        _pass(through),
        2,
        carry=[go, diffuse, ca.MX(0), *found],
        constants=[x_start, P_lead, P_start, *window],
    )
    return last[2:]


def _all(M: ca.MX) -> ca.MX:
    """1 if every sample of the window was measured, and with the nominal noise."""
    ny, n = M.shape
    so_far, mask = ca.SX.sym("so_far"), ca.SX.sym("mask", ny)
    body = ca.Function("all", [so_far, mask], [ca.fmin(so_far, ca.mmin(mask == 1))])
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


def _pass(through: ca.Function) -> ca.Function:
    """Go through the window; where nothing is known of its start, but must be, once more."""
    start = [ca.MX.sym(through.name_in(i), *through.size_in(i)) for i in range(through.n_in())]
    x_start, P_lead, diffuse, *window = start
    P_start = ca.MX.sym("P_start", P_lead.numel())
    go, lacking = ca.MX.sym("go"), ca.MX.sym("lacking")
    (P,) = choose(lacking, [P_start], [P_lead])
    x, P_now, deficient, *more = through(x_start, P, diffuse, *window)
    (lacks,) = choose(deficient, [ca.MX(1)], [lacking])
    results = [x, P_now, *more]
    ignored = [ca.MX.sym(f"r{i}", *r.shape) for i, r in enumerate(results)]
    return ca.Function(
        "pass",
        [go, diffuse, lacking, *ignored, x_start, P_lead, P_start, *window],
        [deficient, ca.MX(0), lacks, *results],
    )
