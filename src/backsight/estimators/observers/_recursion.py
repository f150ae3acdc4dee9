"""Put an observer together to a recursion: measurement between samples, gain, excitation."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.observers._excitation import Excitation, excitation, excitation_start
from backsight.estimators.observers._states import States
from backsight.estimators.observers.adaptive_gain import AdaptiveGain, adapt, start
from backsight.estimators.observers.formulas import (
    Gains,
    Interpolation,
    Spread,
    free_step,
    observer_step,
)
from backsight.estimators.parts.filtering import carry_inputs, choose, packed
from backsight.estimators.parts.gaussian import ramp
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Plan:
    """Everything an observer needs to become a recursion.

    Parameters
    ----------
    states : States
    gains : Gains
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
    gains: Gains
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
    u, y, mask = ca.MX.sym("u", form.nu), ca.MX.sym("y"), ca.MX.sym("mask")
    memory = {
        "x": plan.x0,
        "theta": theta0,
        "Upsilon": np.zeros(form.n * form.p),
        "P": packed(plan.P0),
        "B": np.zeros(form.n + form.p),
        "lam": np.array([plan.lam]),
        "u_last": np.zeros(form.nu),
        "y_last": np.zeros(1),
        "m_last": np.zeros(1),
        "started": np.zeros(1),
        "parameters": np.asarray(form.physical(theta0)).ravel(),
    }
    watch = excitation_start(plan.window, plan.dt, form.p) if form.p else {}
    gain = start(plan.adaptive, plan.dt, x0=plan.x0, theta0=theta0) if plan.adaptive else {}
    everything = [*memory.values(), *watch.values(), *gain.values()]
    symbol, parts = carry_inputs(everything)
    x, theta, Y, P, B, lam, u_last, y_last, m_last, started, known = parts[: len(memory)]
    watched = parts[len(memory) : len(memory) + len(watch)]
    adapted = parts[len(memory) + len(watch) :]

    between = _Between(plan, (u_last, u))
    P_last = _with_noise(plan)(P, B)
    free = choose(started, between.free(x, P_last, theta), [x, P_last])
    e, S = _innovation(plan)(*free, y, mask)
    measured = _measured(plan).call([x, free[0], y_last, y, m_last, mask])
    state = [x, theta, Y, P, B]
    x, theta, Y, P, B = choose(started, between.corrected(state, measured, lam), state)
    x, theta, known, P_out, status = plan.states.observed()(
        x, theta, _with_noise(plan)(P, B), known
    )

    outputs, channels = [lam], [*ESTIMATE_CHANNELS, Channel("lam")]
    if form.p:
        measure = excitation(plan.window, form, dt=plan.dt, sigma=float(np.sqrt(plan.R)))
        *watched, level, excited = measure(*watched, Y, lam, theta)
        outputs.append(level)
        channels.append(Channel("excitation", ("parameter",), labels=form.parameters))
        status = status + int(Status.NOT_EXCITED) * (1 - excited)
    if plan.adaptive:
        adapted, lam = adapt(
            plan.adaptive,
            form,
            plan.integrator,
            upper=plan.lam,
            dt=plan.dt,
            memory=adapted,
            last=(u_last, y_last, m_last),
            data=(u, y, mask),
            estimate=(x, theta, lam),
        )
    x_hat = ca.vertcat(x, known, plan.constants)
    carry = ca.vertcat(x, theta, Y, P, B, lam, u, y, mask, 1, known, *watched, *adapted)
    step = ca.Function(
        name, [symbol, u, y, mask], [carry, x_hat, P_out, x[0], e, S, status, *outputs]
    )
    return Recursion(
        step=step,
        carry0=np.concatenate(everything),
        channels=tuple(channels),
        dt=plan.dt,
        least_samples=plan.adaptive.samples(plan.dt) if plan.adaptive else 1,
    )


class _Between:
    """The way from sample to sample, given the input at both ends."""

    def __init__(self, plan: Plan, u: tuple[ca.MX, ca.MX]) -> None:
        self.plan, self.n = plan, plan.integrator.substeps
        self.u = ramp(self.n, u[0], u[1] if plan.integrator.hold == "foh" else u[0])
        self.h = plan.dt / self.n

    def free(self, x: ca.MX, P: ca.MX, theta: ca.MX) -> list[ca.MX]:
        """State and covariance by the model alone."""
        plan = self.plan
        leaf = free_step(plan.states.form, plan.integrator, plan.spread, h=self.h)
        return scan(leaf, self.n, carry=[x, P], xs=self.u, constants=[theta])[0]

    def corrected(self, state: list[ca.MX], measured: list[ca.MX], lam: ca.MX) -> list[ca.MX]:
        """State, theta, Upsilon and covariance of the observer.

        The last noise is the new one, on which nothing depends at the beginning.
        """
        plan, (x, theta, Y, P, B) = self.plan, state
        ya, yb, wa, wb, on = measured
        leaf = observer_step(
            plan.states.form,
            plan.gains,
            plan.integrator,
            plan.spread,
            h=self.h,
            interpolation=plan.interpolation,
        )
        xs = [*self.u, *ramp(self.n, ya, yb), *ramp(self.n, wa, wb)]
        start = [x, theta, Y, P, ca.horzcat(B, ca.MX.zeros(B.numel())), x]
        end, _ = scan(leaf, self.n, carry=start, xs=xs, constants=[lam, on, theta])
        x, theta, Y, P, both, _ = end
        return [x, theta, Y, _with_noise(plan)(P, both[:, 0]), both[:, 1]]


def _measured(plan: Plan) -> ca.Function:
    """Interpolation of the measurement: ``(x, x_free, y_last, y, m_last, m) -> (...)``.

    The results are what `observer_step` takes at both ends, the weights of the noise of both
    measurements there, and whether anything is measured. After a gap the innovation at its end
    stands for the whole sampling period.
    """
    x, x_free = ca.SX.sym("x", plan.states.form.n), ca.SX.sym("x_free", plan.states.form.n)
    last, y, m_last, m = (ca.SX.sym(k) for k in ("y_last", "y", "m_last", "m"))
    if plan.interpolation == "hold":
        ends = [last, last, ca.SX([1, 0]), ca.SX([1, 0]), m_last]
    else:
        e = y - x_free[0]
        begin = ca.if_else(m_last, last - x[0], e)
        weights = [ca.vertcat(m_last, 1 - m_last), ca.SX([0, 1])]
        if plan.interpolation == "model":
            ends = [begin, e, *weights, m]
        else:
            ends = [x[0] + begin, y, *weights, m]
    return ca.Function("measured", [x, x_free, last, y, m_last, m], ends)


def _with_noise(plan: Plan) -> ca.Function:
    """Covariance with the noise of the last measurement: ``(P, B) -> P``."""
    m, size = plan.states.form.n + plan.states.form.p, plan.spread.size
    vP, B = ca.SX.sym("P", size * (size + 1) // 2), ca.SX.sym("B", m)
    column = ca.vertcat(B, ca.SX.zeros(size - m))
    return ca.Function("with_noise", [vP, B], [vech(unvech(vP) + plan.R * column @ column.T)])


def _innovation(plan: Plan) -> ca.Function:
    """``(x, P, y, mask) -> (e, S)`` from the model's prediction."""
    size = plan.spread.size
    x, vP = ca.SX.sym("x", plan.states.form.n), ca.SX.sym("P", size * (size + 1) // 2)
    y, mask = ca.SX.sym("y"), ca.SX.sym("mask")
    return ca.Function("innovation", [x, vP, y, mask], [mask * (y - x[0]), vP[0] + plan.R])
