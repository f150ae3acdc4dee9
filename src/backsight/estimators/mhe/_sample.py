"""What moving horizon estimation does with one sample."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
from backsight.discrete.runge_kutta import Integrator
from backsight.engine.loops import iterate
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS, Setting
from backsight.estimators.kalman import ekf
from backsight.estimators.mhe._limits import Limits
from backsight.estimators.mhe._window import linearise
from backsight.estimators.mhe.arrival import Arrival, Leaving
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, physical
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.substeps import within_bounds
from backsight.estimators.parts.window import (
    as_columns,
    empty_queue,
    empty_window,
    moved_on,
    queued,
)
from backsight.solvers.box import GaussNewton
from backsight.solvers.trajectory import Chain, iterated, smoothed
from backsight.types import Array

SMALL = 1e-10
"""Residuals below this are rounding errors and are put out as this."""


@dataclasses.dataclass(frozen=True)
class Parts:
    """An estimator fitted to a model.

    Parameters
    ----------
    s : Setting
    inside : Setting
        With the process noise inside the window.
    chain : Chain
    limits : Limits
    arrival : Arrival
    integrator : Integrator
    optimiser : GaussNewton
    lag : int
    """

    s: Setting
    inside: Setting
    chain: Chain
    limits: Limits
    arrival: Arrival
    integrator: Integrator
    optimiser: GaussNewton
    lag: int


@dataclasses.dataclass(frozen=True)
class Solved:
    """A window with its solution, all of it MX; columns are samples.

    Parameters
    ----------
    inputs : list
        Memory and data of the sample.
    prior : list
        State and covariance of the newest sample before its measurement.
    data : list
        The newest sample's scaled u, y, mask.
    U, Y, M, present, X, side, along, eta, nu : MX
        The window, its trajectory and active limits, the trajectory of the last linearisation, and
        the adjoints and multipliers of its solution.
    x_start, spread : MX
        Arrival cost of the window.
    late : MX
        Innovations that wait for the estimate of their sample.
    problem : list
        What `solvers.smoother.smoothed` takes.
    P_end : MX
        Covariance of the newest sample.
    conflict, residual, passes, unfinished, iterations, limit, rejected : MX
        See `solvers.iterated`.
    """

    inputs: list[ca.MX]
    prior: list[ca.MX]
    data: list[ca.MX]
    U: ca.MX
    Y: ca.MX
    M: ca.MX
    present: ca.MX
    X: ca.MX
    side: ca.MX
    along: ca.MX
    eta: ca.MX
    nu: ca.MX
    x_start: ca.MX
    spread: ca.MX
    late: ca.MX
    problem: list[ca.MX]
    P_end: ca.MX
    conflict: ca.MX
    residual: ca.MX
    passes: ca.MX
    unfinished: ca.MX
    iterations: ca.MX
    limit: ca.MX
    rejected: ca.MX


def memory0(parts: Parts) -> dict[str, Array]:
    """The memory before the first sample."""
    s, samples = parts.s, parts.chain.N + 1
    return {
        "x_start": s.x0,
        "spread": parts.arrival.spread0,
        "x_last": s.x0,
        "P_last": parts.chain.stored(s.P0),
        **empty_window(s, samples),
        "present": np.zeros(samples),
        "X": np.tile(s.x0, samples),
        "side": np.zeros(parts.chain.n * samples),
        "late": empty_queue(s, parts.lag),
    }


def solved(parts: Parts) -> Solved:
    """Take a sample into the window and solve it."""
    s, chain, N = parts.s, parts.chain, parts.chain.N
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    symbol, kept = carry_inputs(list(memory0(parts).values()))
    x_start, spread, x_last, P_last, *stored, late = kept
    U, Y, M, present, X, side = as_columns(stored, N + 1)
    called, moved = present[N], present[0]
    U, Y, M, present = moved_on((U, Y, M, present), (u, y, mask, 1))
    ahead = ekf.predict(parts.inside, parts.integrator, "discrete")
    prior = choose(called, ahead.call([x_last, P_last, U[:, N - 1], u]), [x_last, P_last])
    guess = ca.horzcat(X[:, 1:], within(s)(prior[0]))
    solver = iterated(
        chain,
        linearise(s, parts.integrator, parts.limits, chain),
        parts.optimiser,
        proximal=parts.arrival.free,
    )
    P_start = parts.arrival.covariance(spread)
    tried = ca.horzcat(side[:, 1:], side[:, N])
    found = solver(x_start, P_start, moved, guess, tried, U, Y, M, present)
    m = len(chain.sizes)
    X, side, along, *found = found
    stages, (offset, eta, nu, *rest) = found[:m], found[m:]
    problem = [offset, P_start, *stages, side, ca.MX.zeros(*side.shape)]
    return Solved(
        [symbol, *data], prior, [u, y, mask], U, Y, M, present, X, side, along, eta, nu,
        x_start, spread, late, problem, *rest,
    )  # fmt: skip


def recursion(name: str, parts: Parts) -> Recursion:
    """The estimate of a sample, and the memory for the next one."""
    s, chain, N = parts.s, parts.chain, parts.chain.N
    w = solved(parts)
    e, S = ekf.innovation(s)(*w.prior, *w.data)
    (e, S), late = queued(w.late, [e, S], parts.lag)
    end = N - parts.lag
    P = chain.triangle()(smoothed(chain, parts.lag)(*w.problem) if parts.lag else w.P_end)
    x_start, spread = choose(
        w.present[0], parts.arrival.advance(w.x_start, w.spread, _leaving(w, chain)),
        [w.x_start, w.spread],
    )  # fmt: skip
    window = (w.U, w.Y, w.M, w.present, w.X, w.side)
    critical = [x_start, spread, w.X[:, N], w.P_end]
    carry = ca.vertcat(*critical, *(ca.vec(k) for k in window), late)
    carry0 = np.concatenate(list(memory0(parts).values()))
    names, flags = _verdict(chain)(w.side[:, end], w.conflict, w.limit, w.unfinished, w.rejected, P)
    outputs = [
        *physical(s, x=within(s)(w.X[:, end]), P=P, u=w.U[:, end], e=e, S=S, flags=flags).values(),
        w.iterations, w.passes, ca.fmax(w.residual, SMALL),
    ]  # fmt: skip
    channels = (*ESTIMATE_CHANNELS, *(Channel(k) for k in ("iterations", "passes", "kkt")))
    if parts.limits.names:
        outputs.append(names)
        channels = (*channels, Channel("infeasible", ("limit",), labels=parts.limits.names))
    step = ca.Function(name, w.inputs, [_unless_broken(critical, carry, carry0), *outputs])
    return Recursion(step=step, carry0=carry0, channels=channels, dt=s.dt, lag=parts.lag)


def _leaving(w: Solved, chain: Chain) -> Leaving:
    stages = w.problem[2:-2]
    return Leaving(
        u=w.U[:, 0],
        u_next=w.U[:, 1],
        y=w.Y[:, 0],
        mask=w.M[:, 0],
        along=w.along[:, 0],
        along_next=w.along[:, 1],
        stage=[k[:, 0] for k in stages],
        stage_next=[k[:, 1] for k in stages],
        x_next=w.X[:, 1],
        P_next=lambda: smoothed(chain, chain.N - 1)(*w.problem),
    )


def within(s: Setting) -> ca.Function:
    """A state set to its bounds."""
    x = ca.SX.sym("x", s.model.nx)
    return ca.Function("within", [x], [within_bounds(s, x)])


def _unless_broken(critical: list[ca.MX], carry: ca.MX, carry0: Array) -> ca.MX:
    """The memory, or the one from before the first sample if a critical part is not finite."""
    parts = [ca.SX.sym(f"p{k}", c.numel()) for k, c in enumerate(critical)]
    size = ca.sum1(ca.fabs(ca.vertcat(*parts)))
    broken = ca.Function("broken", parts, [ca.logic_not(size < np.inf)])(*critical)
    symbols = [ca.MX.sym("go"), ca.MX.sym("carry", len(carry0)), ca.MX.sym("fresh", len(carry0))]
    body = ca.Function("start_anew", symbols, [ca.MX(0), symbols[2]])
    return iterate(body, 1, carry=[broken, carry], constants=[ca.MX(carry0)])[1]


def _verdict(chain: Chain) -> ca.Function:
    """Limits that contradict each other, and flags."""
    n = chain.n
    side, conflict = ca.SX.sym("side", n), ca.SX.sym("conflict", n, chain.N + 1)
    limit, unfinished, rejected = (ca.SX.sym(k) for k in ("limit", "unfinished", "rejected"))
    P = ca.SX.sym("P", chain.nx * (chain.nx + 1) // 2)
    named = ca.vertcat(ca.SX(0, 1), *(ca.mmax(conflict[r, :]) for r in range(n)))
    flags = Flags(
        clipped=ca.mmax(ca.fabs(side)) if n else 0,
        iteration_limit=ca.fmax(limit, unfinished),
        step_rejected=rejected,
        not_positive_definite=ca.mmin(ca.diag(unvech(P))) < 0,
        infeasible=ca.mmax(named) if n else 0,
    )
    inputs = [side, conflict, limit, unfinished, rejected, P]
    return ca.Function("verdict", inputs, [named, flags.vector()])
