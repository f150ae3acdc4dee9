"""Put an observer together to a recursion: measurement between samples, gain, excitation."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import TuningError
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.observers._excitation import Excitation, excitation, excitation_start
from backsight.estimators.observers._formulas import (
    Interpolation,
    ObserverGains,
    Spread,
    free_step,
    observer_sizes,
    observer_step,
)
from backsight.estimators.observers._states import States
from backsight.estimators.observers.adaptive_gain import AdaptiveGain, adapt, gain_start
from backsight.estimators.parts.covariance import packed
from backsight.estimators.parts.filtering import choose
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, Size, Symmetric, leaf, named_results
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.substeps import ramp
from backsight.estimators.varied_number import VariedNumber, varied_at
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Plan:
    """Everything an observer needs to become a recursion.

    Parameters
    ----------
    states : States
    gains : ObserverGains
    lam : float
        Gain, lambda_max if it adapts [1/s].
    integrator : Integrator
        `hold` is that of the input.
    interpolation : {"model", "linear", "hold"}
        Of the measurement, see `Interpolation`.
    dt, R : float
        Sampling period [s] and variance of the measurement.
    x0, constants : arrays
        Start of the chain (n,), and the constants that are not estimated (q,).
    P0 : (n + p + q, n + p + q) array
    spread : Spread
    adaptive : AdaptiveGain, optional
    window : Excitation
    """

    states: States
    gains: ObserverGains
    lam: float
    integrator: Integrator
    interpolation: Interpolation
    dt: float
    R: float
    x0: Array
    constants: Array
    P0: Array
    spread: Spread
    adaptive: AdaptiveGain | None
    window: Excitation


def assemble_observer(name: str, plan: Plan) -> Recursion:
    """Recursion of an observer.

    The carry holds the estimate of the last sample; a step integrates from there to the present,
    since interpolating the measurement needs the present one. A sample that was not measured is
    bridged by the model.
    """
    form, theta0 = plan.states.form, plan.states.theta0
    varied = isinstance(plan.lam, VariedNumber)
    if varied and plan.adaptive:
        raise TuningError("a gain that adapts cannot be an input: free it without `adaptive`")
    u, y, mask = data = [ca.MX.sym("u", form.nu), ca.MX.sym("y"), ca.MX.sym("mask")]
    watch = excitation_start(plan.window, plan.dt, form.p) if form.p else {}
    gain = gain_start(plan.adaptive, plan.dt, x0=plan.x0, theta0=theta0) if plan.adaptive else {}
    m = Memory(
        x=plan.x0,
        theta=theta0,
        Upsilon=np.zeros(form.n * form.p),
        P=packed(plan.P0),
        B=np.zeros(form.n + form.p),
        lam=plan.lam,
        u_last=np.zeros(form.nu),
        y_last=0,
        m_last=0,
        started=0,
        parameters=np.asarray(form.physical(theta0)).ravel(),
        **watch,
        **gain,
    )

    lam = varied_at(plan.lam, u) if varied else m.lam

    # 1. innovation: the model alone, from the last sample to this one
    between, P_last = _Between(plan, (m.u_last, u)), _with_noise(plan)(m.P, m.B)
    free = choose(m.started, between.free(m.x, P_last, m.theta), [m.x, P_last])
    e, S = _innovation(plan)(*free, y, mask)

    # 2. observer, eq. 5 or eq. 10, with the interpolated measurement
    state = {"x": m.x, "theta": m.theta, "Upsilon": m.Upsilon, "P": m.P, "B": m.B}
    measured = _measured(plan).call([m.x, free[0], m.y_last, y, m.m_last, mask])
    moved = between.corrected(state, measured, lam)
    after = dict(
        zip(state, choose(m.started, list(moved.values()), list(state.values())), strict=True)
    )

    # 3. parameters, bounds, covariance of the states
    P_now = _with_noise(plan)(after["P"], after["B"])
    seen = named_results(plan.states.observed(), after["x"], after["theta"], P_now, m.parameters)
    x, theta, flags = seen["x"], seen["theta"], Flags.of(seen["flags"])
    parameters = seen["parameters"]
    after |= {"x": x, "theta": theta, "parameters": parameters}
    outputs, channels = {"lam": lam}, [*ESTIMATE_CHANNELS, Channel("lam")]

    # 4. excitation, eq. 9
    if form.p:
        measure = excitation(plan.window, form, dt=plan.dt, sigma=float(np.sqrt(plan.R)))
        memory = [getattr(m, name) for name in watch]
        watched = named_results(measure, *memory, after["Upsilon"], lam, theta)
        outputs["excitation"] = watched["level"]
        channels.append(Channel("excitation", ("parameter",), labels=form.parameters))
        flags = dataclasses.replace(flags, not_excited=1 - watched["excited"])
        after |= watched

    # 5. gain of the next sample, eq. 17-19
    after["lam"] = lam
    if plan.adaptive:
        after |= adapt(
            plan.adaptive,
            form,
            plan.integrator,
            upper=plan.lam,
            dt=plan.dt,
            memory={name: getattr(m, name) for name in gain},
            last=(m.u_last, m.y_last, m.m_last),
            data=(u, y, mask),
            estimate=(x, theta, m.lam),
        )
    estimate = {
        "x_hat": plan.states.joined(seen["states"], parameters, plan.constants),
        "P": seen["P"],
        "y_hat": x[0],
        "e": e,
        "S": S,
        "status": flags.status(),
    }
    return m.recursion(
        name,
        data,
        next={**after, "u_last": u, "y_last": y, "m_last": mask, "started": 1},
        outputs={**estimate, **outputs},
        channels=channels,
        dt=plan.dt,
        least_samples=plan.adaptive.samples(plan.dt) if plan.adaptive else 1,
    )


class _Between:
    """The way from sample to sample, given the input at both ends."""

    def __init__(self, plan: Plan, u: tuple[ca.MX, ca.MX]) -> None:
        self.plan, self.n = plan, plan.integrator.steps
        self.u = ramp(self.n, u[0], u[1] if plan.integrator.hold == "foh" else u[0])
        self.h = plan.dt / self.n

    def free(self, x: ca.MX, P: ca.MX, theta: ca.MX) -> list[ca.MX]:
        """State and covariance by the model alone."""
        plan = self.plan
        leaf = free_step(plan.states.form, plan.integrator, plan.spread, h=self.h)
        x, P = scan(leaf, self.n, carry=[x, P], xs=self.u, constants=[theta])[0]
        return [x, _walked(plan)(x, P)]

    def corrected(
        self, state: dict[str, ca.MX], measured: list[ca.MX], lam: ca.MX
    ) -> dict[str, ca.MX]:
        """State, theta, Upsilon and covariance of the observer.

        The last noise is the new one, on which nothing depends at the beginning.
        """
        plan, B = self.plan, state["B"]
        ya, yb, wa, wb, on = measured
        step = observer_step(
            plan.states.form,
            plan.gains,
            plan.integrator,
            plan.spread,
            h=self.h,
            interpolation=plan.interpolation,
        )
        xs = [*self.u, *ramp(self.n, ya, yb), *ramp(self.n, wa, wb)]
        both = ca.horzcat(B, ca.MX.zeros(B.numel()))
        start = {**state, "B": both, "x_free": state["x"]}
        last, _ = scan(
            step, self.n, carry=list(start.values()), xs=xs, constants=[lam, on, state["theta"]]
        )
        end = dict(zip(start, last, strict=True))
        P, both = _with_noise(plan)(end["P"], end["B"][:, 0]), end["B"][:, 1]
        moved = {name: end[name] for name in ("x", "theta", "Upsilon")}
        return {**moved, "P": _walked(plan)(moved["x"], P), "B": both}


def _sizes(plan: Plan) -> dict[str, Size]:
    form, size = plan.states.form, plan.spread.size
    return {**observer_sizes(form), "P": Symmetric(size), "S": Symmetric(1), "B": form.n + form.p}


def _walked(plan: Plan) -> ca.Function:
    """Covariance with the random walks of one sample: ``(x, P) -> P``."""
    Q = ca.SX(ca.sparsify(ca.DM(plan.spread.Q)))

    def formula(x: ca.SX, P: ca.SX) -> Results:
        T = plan.spread.slope(x)
        return {"P": P + ca.densify(T @ Q @ T.T)}

    return leaf("walked", _sizes(plan), formula)


def _measured(plan: Plan) -> ca.Function:
    """Interpolation of the measurement: ``(x, x_free, y_last, y, mask_last, mask) -> (...)``.

    The results are what `observer_step` takes at both ends, the weights of the noise of both
    measurements there, and whether anything is measured. After a gap the innovation at its end
    stands for the whole sampling period.
    """

    def formula(
        x: ca.SX, x_free: ca.SX, y_last: ca.SX, y: ca.SX, mask_last: ca.SX, mask: ca.SX
    ) -> Results:
        if plan.interpolation == "hold":
            only_last = ca.SX([1, 0])
            return {"ya": y_last, "yb": y_last, "wa": only_last, "wb": only_last, "on": mask_last}
        e = y - x_free[0]
        begin = ca.if_else(mask_last, y_last - x[0], e)
        weights = {"wa": ca.vertcat(mask_last, 1 - mask_last), "wb": ca.SX([0, 1])}
        if plan.interpolation == "model":
            return {"ya": begin, "yb": e, **weights, "on": mask}
        return {"ya": x[0] + begin, "yb": y, **weights, "on": mask}

    return leaf("measured", _sizes(plan), formula)


def _with_noise(plan: Plan) -> ca.Function:
    """Covariance with the noise of the last measurement: ``(P, B) -> P``."""
    form, size = plan.states.form, plan.spread.size

    def formula(P: ca.SX, B: ca.SX) -> Results:
        column = ca.vertcat(B, ca.SX.zeros(size - form.n - form.p))
        return {"P": P + plan.R * column @ column.T}

    return leaf("with_noise", _sizes(plan), formula)


def _innovation(plan: Plan) -> ca.Function:
    """``(x, P, y, mask) -> (e, S)`` from the model's prediction."""

    def formula(x: ca.SX, P: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        return {"e": mask * (y - x[0]), "S": P[0, 0] + plan.R}

    return leaf("innovation", _sizes(plan), formula)
