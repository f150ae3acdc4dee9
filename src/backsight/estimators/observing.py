"""Put an observer together to a recursion: measurement between samples, gain, excitation."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.adaptive_gain import AdaptiveGain, adapt, start
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.excitation import Excitation, excitation, excitation_start
from backsight.estimators.filtering import carry_inputs, choose, packed
from backsight.estimators.high_gain import Gains, Spread, free_step, observer_step
from backsight.estimators.observed import States
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
    ramp_output : bool
        Interpolate the measurement between samples; holding it delays it by half a sample.
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
    ramp_output: bool
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
        "lam": np.array([plan.lam]),
        "u_last": np.zeros(form.nu),
        "y_last": np.zeros(1),
        "started": np.zeros(1),
        "parameters": np.asarray(form.physical(theta0)).ravel(),
    }
    watch = excitation_start(plan.window, plan.dt, form.p) if form.p else {}
    gain = start(plan.adaptive, form, plan.dt) if plan.adaptive else {}
    everything = [*memory.values(), *watch.values(), *gain.values()]
    symbol, parts = carry_inputs(everything)
    x, theta, Y, P, lam, u_last, y_last, started, known = parts[: len(memory)]
    watched = parts[len(memory) : len(memory) + len(watch)]
    adapted = parts[len(memory) + len(watch) :]

    between = _Between(plan, (u_last, u), (y_last, y if plan.ramp_output else y_last))
    free = choose(started, between.free(x, P, theta), [x, P])
    e, S = _innovation(plan)(*free, y, mask)
    state = [x, theta, Y, P]
    x, theta, Y, P = choose(started, between.corrected(state, lam, mask), state)
    x, theta, known, P_out, status = plan.states.observed()(x, theta, P, known)
    y_hold = choose(mask, [y], [x[0]])[0]

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
            data=(u, y, mask),
            estimate=(x, theta, lam),
        )
    x_hat = ca.vertcat(x, known, plan.constants)
    carry = ca.vertcat(x, theta, Y, P, lam, u, y_hold, 1, known, *watched, *adapted)
    step = ca.Function(
        name, [symbol, u, y, mask], [carry, x_hat, P_out, x[0], e, S, status, *outputs]
    )
    return Recursion(
        step=step, carry0=np.concatenate(everything), channels=tuple(channels), dt=plan.dt
    )


class _Between:
    """The way from sample to sample, given input and measurement at both ends."""

    def __init__(self, plan: Plan, u: tuple[ca.MX, ca.MX], y: tuple[ca.MX, ca.MX]) -> None:
        self.plan, self.n = plan, plan.integrator.substeps
        end = u[1] if plan.integrator.hold == "foh" else u[0]
        self.u = _ramp(self.n, u[0], end)
        self.y = _ramp(self.n, *y)
        self.h = plan.dt / self.n

    def free(self, x: ca.MX, P: ca.MX, theta: ca.MX) -> list[ca.MX]:
        """State and covariance by the model alone."""
        plan = self.plan
        leaf = free_step(plan.states.form, plan.integrator, plan.spread, h=self.h)
        return scan(leaf, self.n, carry=[x, P], xs=self.u, constants=[theta])[0]

    def corrected(self, state: list[ca.MX], lam: ca.MX, on: ca.MX) -> list[ca.MX]:
        """State, theta, Upsilon and covariance of the observer."""
        plan = self.plan
        leaf = observer_step(plan.states.form, plan.gains, plan.integrator, plan.spread, h=self.h)
        xs = [*self.u, *self.y]
        return scan(leaf, self.n, carry=state, xs=xs, constants=[lam, on])[0]


def _ramp(n: int, a: ca.MX, b: ca.MX) -> list[ca.MX]:
    """Values at the beginning and at the end of n sub-steps, side by side."""
    first, last = ca.SX.sym("a", a.numel()), ca.SX.sym("b", b.numel())
    grid = [first + (k / n) * (last - first) for k in range(n + 1)]
    name = f"ramp_{n}_of_{a.numel()}"
    columns = [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])]
    return list(ca.Function(name, [first, last], columns)(a, b))


def _innovation(plan: Plan) -> ca.Function:
    """``(x, P, y, mask) -> (e, S)`` from the model's prediction."""
    size = plan.spread.size
    x, vP = ca.SX.sym("x", plan.states.form.n), ca.SX.sym("P", size * (size + 1) // 2)
    y, mask = ca.SX.sym("y"), ca.SX.sym("mask")
    return ca.Function("innovation", [x, vP, y, mask], [mask * (y - x[0]), vP[0] + plan.R])
