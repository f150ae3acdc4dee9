"""Moving horizon estimation for linear models: least squares over a window."""

import dataclasses
import numbers
from collections.abc import Sequence
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.engine.loops import iterate, scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator, Setting
from backsight.estimators.linear_windows._limited import limited
from backsight.estimators.linear_windows._window_filter import window_filter
from backsight.estimators.linear_windows.stacked import Gains, gains, in_units, product
from backsight.estimators.parts import gaussian
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.parts.limits import Limit, Limits, limits_of
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
from backsight.solvers.trajectory import by_name


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
            found = _with_limits(system, limits, self, start, window, tried)
        else:
            found = _without_limits(system, self, start, window)
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


RAISED = (Status.CLIPPED, Status.INFEASIBLE, Status.ITERATION_LIMIT)
"""Meaning of the flags that limits add to *unobserved*."""

Results = dict[str, ca.MX]
Window = Sequence[ca.MX]
"""Inputs, outputs, masks and presence of the samples, side by side."""


def _without_limits(
    system: Linear, e: LinearMHE, start: Sequence[ca.MX], window: Window
) -> Results:
    """x, P and flags of the last sample of a window."""
    lacking, x, P = _solve(system, e, start, window, samples=(-1,))
    return {"x": x, "P": P, "flags": lacking}


def _with_limits(
    system: Linear,
    limits: Limits,
    e: LinearMHE,
    start: Sequence[ca.MX],
    window: Window,
    tried: ca.MX,
) -> Results:
    """The same, active limits, and limits that contradict each other; `tried` are a guess of them.

    Without arrival cost the window is first solved without limits, which gives the prior that
    `limited` needs, and the estimate where no limit is active.
    """
    full = window[3][0]
    if e.arrival == 0:
        lacking, x, P, *first = _solve(system, e, start, window, samples=(-1, 0))
        free, wide = [x, P], _wide()(full, lacking)
        start = choose(wide, first, start)
    else:
        lacking = wide = ca.MX(0)
        start = [start[0], _plan(system.s, e.arrival)(1, full, start[1])[2]]
        free = start
    found = by_name(limited(system, limits, e.N), [*start, wide, *window, tried])
    course = [found[k] for k in ("x", "P", "side", "held", "conflict", "open")]
    x, P, conflict, raised = _verdict(system.s, *tried.shape)(*free, wide, *course)
    flags = ca.vertcat(lacking, raised)
    return {"x": x, "P": P, "side": found["side"], "conflict": conflict, "flags": flags}


def _wide() -> ca.Function:
    full, lacking = ca.SX.sym("full"), ca.SX.sym("lacking")
    return ca.Function("wide", [full, lacking], [full * (1 - lacking)])


def _verdict(s: Setting, n: int, m: int) -> ca.Function:
    """The estimate, limits that contradict each other, and the flags of `RAISED`.

    ``(x_free, P_free, wide, x, P, side, held, conflict, open) -> (x, P, conflict, flags)``. Where
    the prior is wide and no limit is active, the estimate is the one without limits, exactly; where
    they hold, the state is within its bounds to the last digit.
    """
    nx = s.model.nx
    x_free, x = ca.SX.sym("x_free", nx), ca.SX.sym("x", nx)
    vP_free, vP = (ca.SX.sym(k, nx * (nx + 1) // 2) for k in ("P_free", "P"))
    side, conflict = ca.SX.sym("side", n, m), ca.SX.sym("conflict", n, m)
    wide, held, unfinished = (ca.SX.sym(k) for k in ("wide", "held", "open"))
    named = ca.vertcat(*(ca.mmax(conflict[r, :]) for r in range(n)))
    infeasible = ca.mmax(named)
    unmoved = ca.logic_and(wide, ca.mmax(ca.vec(ca.fabs(side))) == 0)
    found = ca.if_else(unmoved, x_free, ca.if_else(infeasible, x, gaussian.clip(s, x)))
    known = ca.if_else(ca.logic_and(wide, ca.logic_not(held)), vP_free, vP)
    flags = ca.vertcat(ca.mmax(ca.fabs(side[:, m - 1])), infeasible, unfinished)
    return ca.Function(
        "verdict",
        [x_free, vP_free, wide, x, vP, side, held, conflict, unfinished],
        [found, known, named, flags],
    )


DEFICIENT = 2
"""Place of the flag among the results of `window_filter`."""


def _solve(
    system: Linear,
    e: LinearMHE,
    start: Sequence[ca.MX],
    window: Window,
    *,
    samples: Sequence[int],
) -> list[ca.MX]:
    """Solve a window without its limits: 1 if its measurements do not suffice, x and P of samples.

    The samples are the last one, or the last and the first. A full window without gaps is a product
    with constant gains; others are gone through sample by sample.
    """
    U, Y, M, present = window
    through = window_filter(system, e.N)
    go, diffuse, P_lead = _plan(system.s, e.arrival)(_all(M), present[0], start[1])
    results = [through.size_out(i) for i in range(through.n_out()) if i != DEFICIENT]
    found = [ca.MX.zeros(*size) for size in results[: 2 * len(samples)]]
    if e.arrival == 0:
        fixed = [gains(system, e.N, at=at) for at in samples]
        found = [
            k
            for g in fixed
            for k in (
                product(g.M, ca.vec(Y)) + product(g.N_u, ca.vec(U)),
                ca.MX(packed(g.P)),
            )
        ]
    last = iterate(
        _pass(through, len(found)),
        2,
        carry=[go, diffuse, ca.MX(0), *found],
        constants=[start[0], P_lead, start[1], *window],
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


def _pass(through: ca.Function, wanted: int) -> ca.Function:
    """Go through the window; where nothing is known of its start, but must be, once more.

    Of the results of `window_filter` only so many are wanted.
    """
    start = [ca.MX.sym(through.name_in(i), *through.size_in(i)) for i in range(through.n_in())]
    x_start, P_lead, diffuse, *window = start
    P_start = ca.MX.sym("P_start", P_lead.numel())
    go, lacking = ca.MX.sym("go"), ca.MX.sym("lacking")
    (P,) = choose(lacking, [P_start], [P_lead])
    x, P_now, deficient, *more = through(x_start, P, diffuse, *window)
    (lacks,) = choose(deficient, [ca.MX(1)], [lacking])
    results = [x, P_now, *more][:wanted]
    ignored = [ca.MX.sym(f"r{i}", *r.shape) for i, r in enumerate(results)]
    return ca.Function(
        "pass",
        [go, diffuse, lacking, *ignored, x_start, P_lead, P_start, *window],
        [deficient, ca.MX(0), lacks, *results],
    )
