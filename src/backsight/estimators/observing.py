"""Put an observer together to a recursion: measurement between samples, gain, excitation."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.adaptive_gain import AdaptiveGain, evaluation, gain_step, start
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.excitation import Excitation, excitation, excitation_start
from backsight.estimators.filtering import carry_inputs, choose, packed
from backsight.estimators.high_gain import Gains, observer_step
from backsight.models.affine import AffineForm
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Plan:
    """Everything an observer needs to become a recursion.

    Parameters
    ----------
    form : AffineForm
    gains : Gains
    lam : float
        Gain, lambda_max if it adapts [1/s].
    integrator : Integrator
        `hold` is that of the input.
    ramp_output : bool
        Interpolate the measurement between samples; holding it delays it by half a sample.
    dt, R : float
        Sampling period [s] and variance of the measurement.
    x0, theta0, P0 : arrays
        Start of the chain (n,), of theta (p,) and their joint covariance (n + p, n + p).
    frozen, P_frozen : arrays
        Constant states that are not estimated, (q,) and their covariance (q, q).
    adaptive : AdaptiveGain, optional
    window : Excitation
    """

    form: AffineForm
    gains: Gains
    lam: float
    integrator: Integrator
    ramp_output: bool
    dt: float
    R: float
    x0: Array
    theta0: Array
    P0: Array
    frozen: Array
    P_frozen: Array
    adaptive: AdaptiveGain | None
    window: Excitation


def assemble_observer(name: str, plan: Plan) -> Recursion:
    """Recursion of an observer.

    The carry holds the estimate of the last sample; a step integrates from there to the present,
    since interpolating the measurement needs the present one. A sample that was not measured is
    bridged by the model.
    """
    form, p = plan.form, len(plan.form.combinations)
    nu = form.phi.numel_in(1)
    u, y, mask = ca.MX.sym("u", nu), ca.MX.sym("y"), ca.MX.sym("mask")
    memory = {
        "x": plan.x0,
        "theta": plan.theta0,
        "Upsilon": np.zeros(form.n * p),
        "P": packed(plan.P0),
        "lam": np.array([plan.lam]),
        "u_last": np.zeros(nu),
        "y_last": np.zeros(1),
        "started": np.zeros(1),
        "parameters": np.asarray(form.physical(plan.theta0)).ravel(),
    }
    extra: dict[str, Array] = excitation_start(plan.window, plan.dt, p) if p else {}
    gain_memory = start(plan.adaptive, form, plan.dt) if plan.adaptive else {}
    everything = [*memory.values(), *extra.values(), *gain_memory.values()]
    symbol, parts = carry_inputs(everything)
    x, theta, Y, P, lam, u_last, y_last, started, known = parts[: len(memory)]
    of_excitation = parts[len(memory) : len(memory) + len(extra)]
    of_gain = parts[len(memory) + len(extra) :]

    before = [x, theta, Y, P]
    y_end = y if plan.ramp_output else y_last
    free = choose(started, _advance(plan, before, u_last, u, y_last, y_end, lam, ca.MX(0)), before)
    moved = choose(started, _advance(plan, before, u_last, u, y_last, y_end, lam, mask), before)
    x, theta, Y, P = moved
    e, S = _innovation(plan)(free[0], free[3], y, mask)
    y_hold = choose(mask, [y], [x[0]])[0]

    outputs_extra, excited = [lam], ca.MX(1)
    after_excitation: list[ca.MX] = []
    if p:
        measure = excitation(plan.window, form, dt=plan.dt, sigma=float(np.sqrt(plan.R)))
        *after_excitation, level, excited = measure(*of_excitation, Y, lam, theta)
        outputs_extra.append(level)
    after_gain: list[ca.MX] = []
    if plan.adaptive:
        after_gain, lam = _adapt(plan, plan.adaptive, of_gain, (u, y, mask), (x, theta, lam))
    known, P_out, status = _physical(plan)(theta, P, known, excited)
    x_hat = ca.vertcat(x, known, plan.frozen)
    carry = [x, theta, Y, P, lam, u, y_hold, 1, known, *after_excitation, *map(ca.vec, after_gain)]
    outputs = [x_hat, P_out, x[0], e, S, status, *outputs_extra]
    step = ca.Function(name, [symbol, u, y, mask], [ca.vertcat(*carry), *outputs])
    channels = (*ESTIMATE_CHANNELS, Channel("lam"))
    if p:
        channels = (*channels, Channel("excitation", ("parameter",), labels=form.parameters))
    return Recursion(step=step, carry0=np.concatenate(everything), channels=channels, dt=plan.dt)


def _advance(
    plan: Plan,
    state: list[ca.MX],
    ua: ca.MX,
    ub: ca.MX,
    ya: ca.MX,
    yb: ca.MX,
    lam: ca.MX,
    on: ca.MX,
) -> list[ca.MX]:
    """Observer from sample to sample."""
    n = plan.integrator.substeps
    leaf = observer_step(
        plan.form, plan.gains, plan.integrator, h=plan.dt / n, density=plan.R * plan.dt
    )
    a, b = ca.SX.sym("a", ua.numel() + 1), ca.SX.sym("b", ua.numel() + 1)
    grid = [a + (k / n) * (b - a) for k in range(n + 1)]
    ramps = [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])]
    rows = [m for r in ramps for m in (r[:-1, :], r[-1, :])]
    ramp = ca.Function(f"data_ramp_{n}", [a, b], rows)
    held = ub if plan.integrator.hold == "foh" else ua
    u_a, y_a, u_b, y_b = ramp(ca.vertcat(ua, ya), ca.vertcat(held, yb))
    final, _ = scan(leaf, n, carry=state, xs=[u_a, u_b, y_a, y_b], constants=[lam, on])
    return final


def _innovation(plan: Plan) -> ca.Function:
    """``(x, P, y, mask) -> (e, S)`` from the model's prediction."""
    size = len(plan.P0)
    x, vP = ca.SX.sym("x", plan.form.n), ca.SX.sym("P", size * (size + 1) // 2)
    y, mask = ca.SX.sym("y"), ca.SX.sym("mask")
    return ca.Function("innovation", [x, vP, y, mask], [mask * (y - x[0]), vP[0] + plan.R])


def _physical(plan: Plan) -> ca.Function:
    """``(theta, P, last parameters, excited) -> (parameters, P of all states, status)``."""
    form, p = plan.form, len(plan.form.combinations)
    n, q = form.n, len(plan.frozen)
    theta, last, excited = ca.SX.sym("theta", p), ca.SX.sym("last", p), ca.SX.sym("excited")
    vP = ca.SX.sym("P", (n + p) * (n + p + 1) // 2)
    defined = ca.SX(1)
    for i in form.divisors:
        reference = float(plan.theta0[i])
        defined = ca.if_else(theta[i] * np.sign(reference) > 1e-9 * abs(reference), defined, 0)
    safe = ca.if_else(defined, theta, ca.SX(plan.theta0))
    values = form.physical.call([safe])[0] if p else ca.SX(0, 1)
    J = ca.SX.eye(n + p)
    if p:
        J[n:, n:] = ca.substitute(ca.jacobian(form.physical.call([theta])[0], theta), theta, safe)
    P = ca.SX.zeros(n + p + q, n + p + q)
    P[: n + p, : n + p] = J @ unvech(vP) @ J.T
    P[n + p :, n + p :] = ca.SX(plan.P_frozen)
    status = int(Status.UNDEFINED) * (1 - defined) + int(Status.NOT_EXCITED) * (1 - excited)
    return ca.Function(
        "observed",
        [theta, vP, last, excited],
        [ca.if_else(defined, values, last), vech(ca.densify(P)), status],
    )


def _adapt(
    plan: Plan,
    gain: AdaptiveGain,
    memory: list[ca.MX],
    data: tuple[ca.MX, ca.MX, ca.MX],
    estimate: tuple[ca.MX, ca.MX, ca.MX],
) -> tuple[list[ca.MX], ca.MX]:
    """Memory of the adaptive gain after this sample, and lambda of the next one."""
    x, theta, lam = estimate
    stride, evaluations = gain.lengths(plan.dt)
    samples = stride * evaluations + 1
    S, evaluated, elapsed, history, *windows = memory
    history = ca.reshape(history, x.numel() + theta.numel(), evaluations)
    U, Y, M = (
        ca.horzcat(ca.reshape(w, d.numel(), samples)[:, 1:], d)
        for w, d in zip(windows, data, strict=True)
    )
    due, elapsed = _clock(stride)(elapsed)
    S, evaluated, history = evaluation(plan.form, gain, plan.integrator, plan.dt)(
        due, S, evaluated, history, x, theta, U, Y, M
    )
    lam = gain_step(gain, plan.lam, plan.dt)(lam, S)
    return [S, evaluated, elapsed, history, U, Y, M], lam


def _clock(stride: int) -> ca.Function:
    """``elapsed -> (due, elapsed)``: due at the first sample and every `stride` samples."""
    elapsed = ca.SX.sym("elapsed")
    following = ca.if_else(elapsed + 1 >= stride, 0, elapsed + 1)
    return ca.Function("clock", [elapsed], [ca.if_else(elapsed > 0, 0, 1), following])
