"""Moving horizon estimation for linear models: least squares over a window."""

import dataclasses
import numbers
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator
from backsight.estimators.linear_windows._free import without_limits
from backsight.estimators.linear_windows._limited import RAISED, with_limits
from backsight.estimators.linear_windows.stacked import Gains, gains, in_units
from backsight.estimators.parts import gaussian
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.parts.limits import Limit, limits_of
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
from backsight.schema import Status


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
    Limits are imposed by an exact active set method along the trajectory, that of `MHE`; inactive
    ones change nothing. If they contradict each other, the estimate is the one without limits, the
    status says *infeasible*, and the output ``infeasible`` names them. P is without the limits that
    happen to be active: that they are is known from the data only. Limits with the same lower and
    upper end are equations, and count as exact measurements.

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
        limits = limits_of(s, s.Q, self.limits, {})
        n = len(limits.names)
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        memory = {
            "x_start": s.x0,
            "P_start": packed(s.P0),
            "x_last": s.x0,
            "P_last": packed(s.P0),
            **empty_window(s, N + 1),
            "present": np.zeros(N + 1),
            "side": np.zeros(n * (N + 1)),
        }
        symbol, parts = carry_inputs(list(memory.values()))
        kept = dict(zip(memory, parts, strict=True))
        columns = ("U", "Y", "M", "present", "side")
        before = dict(zip(columns, as_columns([kept[k] for k in columns], N + 1), strict=True))
        U, Y, M, present = window = [before[k] for k in columns[:4]]

        # Innovation of the newest sample; the one that leaves goes into the arrival cost.
        time_update, free = predict_packed(system), without_bounds(s)
        last, start = ([kept[f"x_{k}"], kept[f"P_{k}"]] for k in ("last", "start"))
        prior = choose(present[N], time_update.call([*last, U[:, N], u]), last)
        e, S = gaussian.innovation(s)(*prior, u, y, mask)
        corrected = gaussian.correct(free)(*start, U[:, 0], Y[:, 0], M[:, 0])[:2]
        moved = time_update.call([*corrected, U[:, 0], U[:, 1]])
        start = choose(present[0], moved, start)
        window = [*advance(window, (u, y, mask, 1))]

        # The window, with its limits if there are any.
        if n:
            tried = ca.horzcat(before["side"][:, 1:], ca.MX.zeros(n))
            found = with_limits(system, limits, N, self.arrival, start, window, tried)
        else:
            found = without_limits(system, N, self.arrival, start, window)
        end = [found["x"], found["P"]]
        carry = ca.vertcat(*start, *end, *map(ca.vec, (*window, found.get("side", ca.MX(0, 1)))))
        meaning = (Status.UNOBSERVED, *(RAISED if n else ()))
        outputs = physical(s, meaning)(*end, u, e, S, found["flags"])
        named = Channel("infeasible", ("limit",), labels=limits.names)
        return Recursion(
            step=ca.Function(
                self.key,
                [symbol, *data],
                [carry, *outputs, *([found["conflict"]] if n else [])],
            ),
            carry0=np.concatenate(list(memory.values())),
            channels=(*ESTIMATE_CHANNELS, *([named] if n else [])),
            dt=dt,
        )

    def _system(self, model: Model, dt: float) -> Linear:
        return linear(model, dt, noise=self.noise, prior=self.prior, hold=self.hold)
