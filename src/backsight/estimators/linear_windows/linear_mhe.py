"""Moving horizon estimation for linear models: least squares over a window."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import casadi as ca
import numpy as np

from backsight.description import Horizon, Share, Sound
from backsight.discrete.runge_kutta import Hold
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS, AbstractEstimator
from backsight.estimators.kalman import ekf
from backsight.estimators.kalman.exact_sensors import correcting_exactly, exact_sensors
from backsight.estimators.kalman.kf import predict_linear
from backsight.estimators.kalman.square_root import refuse_too_wide
from backsight.estimators.linear_windows._exact_window import exactly_solved
from backsight.estimators.linear_windows._least_squares import Window, least_squares, start_of
from backsight.estimators.linear_windows._limited import limited
from backsight.estimators.linear_windows.stacked import Gains, gains, in_units
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.filtering import choose, data_inputs, physical
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.limits import Limit, Limits, limits_of, names_used_twice
from backsight.estimators.parts.linear import (
    Linear,
    Varying,
    in_time,
    linear,
    require_observable,
    without_bounds,
)
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.parts.window import moved_on, no_window
from backsight.estimators.scaled import Setting
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.model import Model
from backsight.schema import Innovations
from backsight.solvers.trajectory import by_name


@dataclasses.dataclass(frozen=True)
class LinearMHE(AbstractEstimator):
    r"""Least-squares moving horizon estimator.

    At every sample k it finds the trajectory :math:`x_{i+1} = A x_i + B u_i + w_i` through the
    window k - N ... k that minimises

    .. math:: a\,(x_{k-N} - \bar x)' \bar P^{-1} (x_{k-N} - \bar x)
        + \sum_{i=k-N}^{k-1} w_i' Q^{-1} w_i + \sum_{i=k-N}^{k} v_i' R^{-1} v_i,
        \qquad v_i = y_i - C x_i - D u_i,

    and puts out its end. Q may be singular or zero: it is never inverted. With a = 0 nothing from
    before the window counts. With Q = 0, too, it is the batch estimator of the lectures,
    :math:`\hat x_k = M Y + N_u U`; with a = 1 the Kalman filter, with matrices that may change.

    Parameters
    ----------
    noise : Noise
    prior : Prior
        Used until the window is full.
    N : int
        Horizon in sampling periods; the window holds N + 1 samples.
    arrival_weight : float
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

    Examples
    --------
    >>> noise, prior = bs.Noise(sigma_y=1e-3, sigma_w=1e-4), bs.Prior(sigma_x0=1.0)
    >>> bs.LinearMHE(noise, prior, N=10).arrival_weight
    0.0
    """

    key: ClassVar[str] = "lmhe"
    title: ClassVar[str] = "Least-squares moving horizon estimator"
    weighs: ClassVar[bool] = True
    noise_states: ClassVar[bool] = True
    varies_noise: ClassVar[tuple[str, ...]] = ("Q",)
    varied_settings: ClassVar[tuple[str, ...]] = ("arrival_weight",)

    noise: Noise
    prior: Prior
    N: Horizon = 20
    arrival_weight: Share = 0.0
    hold: Hold = "zoh"
    limits: tuple[Limit, ...] = ()

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("limits"):
            yield from names_used_twice(self.limits)

    @property
    def innovations(self) -> Innovations:
        """See `AbstractEstimator.innovations`."""
        return "white" if self.arrival_weight == 1 else "coloured"

    @property
    def forgets(self) -> bool:
        """See `AbstractEstimator.forgets`."""
        return self.arrival_weight == 0

    def gains(self, model: Model, dt: float) -> Gains:
        """Gains of a full window without arrival cost, physical units, see `Gains`."""
        system = linear(model, dt, noise=self.noise, prior=self.prior, hold=self.hold)
        require_observable(model, samples=self.N + 1)
        return in_units(gains(system, self.N), system.s)

    def build(self, model: Model, dt: float) -> Recursion:
        """See `AbstractEstimator.build`."""
        system = self._system(model, dt)
        s, N = system.s, self.N
        at_rest = system.at_rest if isinstance(system, Varying) else None
        refuse_too_wide(s, "LinearMHE", linearised=at_rest)
        if self.arrival_weight == 0 and isinstance(system, Linear):
            require_observable(model, samples=N + 1)
        limits = limits_of(s, s.Q, self.limits, {})
        by_equations = self.arrival_weight == 0 and exact_sensors(s)
        n = 0 if by_equations else len(limits.names)
        data = data_inputs(s)
        u, y, mask = s.enter()(*data)
        kept = Covariance(s.model.nx)
        m = Memory(
            x_start=s.x0,
            P_start=kept.kept(s.P0),
            x_last=s.x0,
            P_last=kept.kept(s.P0),
            **no_window(s, N + 1),
            present=np.zeros((1, N + 1)),
            side=np.zeros((n, N + 1)),
        )

        # Innovation of the newest sample; the one that leaves goes into the arrival cost.
        time_update, free = predict_linear(system), without_bounds(s)
        last = [m.x_last, m.P_last]
        prior = choose(m.present[N], time_update.call([*last, m.U[:, N], u]), last)
        e, S = ekf.innovation(s)(*prior, u, y, mask)
        leaving = [m.U[:, 0], m.Y[:, 0], m.M[:, 0]]
        update = correcting_exactly(s, innovation=ekf.innovation(s), correct=ekf.correct(free))
        corrected = update(m.x_start, m.P_start, *leaving)[:2]
        moved = time_update.call([*corrected, m.U[:, 0], m.U[:, 1]])
        x_start, P_start = choose(m.present[0], moved, [m.x_start, m.P_start])
        window = [*moved_on((m.U, m.Y, m.M, m.present), (u, y, mask, 1))]

        # The window, with its limits if there are any.
        start = [x_start, kept.triangle()(P_start)]
        channels, named = ESTIMATE_CHANNELS, {}
        if s.parts and (n or isinstance(system, Varying)):
            raise TuningError("noise that inputs multiply goes with constant matrices, no limits")
        if n and isinstance(system, Varying):
            raise TuningError(
                f"{', '.join(limits.names)}: limits go with constant coefficients, but those of "
                f"model '{model.name}' change with its inputs; use MHE"
            )
        if by_equations:
            found = exactly_solved(system, limits, N, start, window)
        elif n and isinstance(system, Linear):
            tried = ca.horzcat(m.side[:, 1:], ca.MX.zeros(n))
            found = _with_limits(system, limits, self, start, window, tried)
            channels += (Channel("infeasible", ("limit",), labels=limits.names),)
            named = {"infeasible": found["conflict"]}
        else:
            found = _without_limits(system, self, start, window)
        x, P = found["x"], found["P"]
        return m.recursion(
            self.key,
            data,
            next={
                "x_start": x_start,
                "P_start": P_start,
                "x_last": x,
                "P_last": kept.of_triangle()(P),
                **dict(zip(("U", "Y", "M", "present"), window, strict=True)),
                "side": found.get("side", ca.MX(0, N + 1)),
            },
            outputs={**physical(s, x=x, P=P, u=u, e=e, S=S, flags=found["flags"]), **named},
            channels=channels,
            dt=dt,
        )

    def variants(self) -> Mapping[str, AbstractEstimator]:
        """See `AbstractEstimator.variants`: the weights 1 and 0 of the arrival cost."""
        others = [w for w in (1.0, 0.0) if w != self.arrival_weight]
        every = [self, *(dataclasses.replace(self, arrival_weight=w) for w in others)]
        return {f"arrival_weight = {e.arrival_weight:g}": e for e in every}

    def _system(self, model: Model, dt: float) -> Linear | Varying:
        return in_time(
            model, dt, noise=self.noise, prior=self.prior, hold=self.hold, noiseless=True
        )


Estimate = dict[str, ca.MX]


def _without_limits(
    system: Linear | Varying, e: LinearMHE, start: Sequence[ca.MX], window: Window
) -> Estimate:
    """x, P and flags of the last sample of a window."""
    lacking, x, P = least_squares(system, e.N, e.arrival_weight, start, window, samples=(-1,))
    return {"x": x, "P": P, "flags": Flags(unobserved=lacking).vector()}


def _with_limits(
    system: Linear,
    limits: Limits,
    e: LinearMHE,
    start: Sequence[ca.MX],
    window: Window,
    tried: ca.MX,
) -> Estimate:
    """The same, active limits, and limits that contradict each other; `tried` are a guess of them.

    Without arrival cost the window is first solved without limits, which gives the prior that
    `limited` needs, and the estimate where no limit is active.
    """
    full = window[3][0]
    if e.arrival_weight == 0:
        lacking, x, P, *first = least_squares(
            system, e.N, e.arrival_weight, start, window, samples=(-1, 0)
        )
        free, wide = [x, P], _wide()(full, lacking)
        start = choose(wide, first, start)
    else:
        lacking = wide = ca.MX(0)
        u = window[0][:, -1]
        start = [start[0], start_of(system.s, e.arrival_weight)(1, full, start[1], u)[2]]
        free = start
    found = by_name(limited(system, limits, e.N), [*start, wide, *window, tried])
    course = [found[k] for k in ("x", "P", "side", "held", "conflict", "open")]
    bounds = [r for r in range(len(limits.names)) if r not in limits.exact]
    x, P, conflict, raised = _verdict(system.s, bounds, *tried.shape)(*free, wide, *course)
    flags = dataclasses.replace(Flags.of(raised), unobserved=lacking).vector()
    return {"x": x, "P": P, "side": found["side"], "conflict": conflict, "flags": flags}


def _wide() -> ca.Function:

    def formula(full: ca.SX, lacking: ca.SX) -> Results:
        return {"wide": full * (1 - lacking)}

    return leaf("wide", {"full": 1, "lacking": 1}, formula)


def _verdict(s: Setting, bounds: list[int], n: int, m: int) -> ca.Function:
    """The estimate, limits that contradict each other, and flags; `bounds` are no sensors.

    ``(x_free, P_free, wide, x, P, side, held, conflict, open) -> (x, P, conflict, flags)``. Where
    the prior is wide and no limit is active, the estimate is the one without limits, exactly; where
    they hold, the state is within its bounds to the last digit.
    """

    def formula(
        x_free: ca.SX, P_free: ca.SX, wide: ca.SX, x: ca.SX, P: ca.SX,
        side: ca.SX, held: ca.SX, conflict: ca.SX, unfinished: ca.SX,
    ) -> Results:  # fmt: skip
        names = ca.vertcat(*(ca.mmax(conflict[r, :]) for r in range(n)))
        infeasible = ca.mmax(names)
        unmoved = ca.logic_and(wide, ca.mmax(ca.vec(ca.fabs(side))) == 0)
        flags = Flags(
            clipped=ca.mmax(ca.fabs(side[bounds, m - 1])) if bounds else 0,
            infeasible=infeasible,
            iteration_limit=unfinished,
        )
        return {
            "x": ca.if_else(unmoved, x_free, ca.if_else(infeasible, x, within_bounds(s, x))),
            "P": ca.if_else(ca.logic_and(wide, ca.logic_not(held)), P_free, P),
            "conflicting": names,
            "flags": flags.vector(),
        }

    limits = {"side": (n, m), "conflict": (n, m), "wide": 1, "held": 1, "unfinished": 1}
    return leaf("verdict", {**notation(s), **limits}, formula)
