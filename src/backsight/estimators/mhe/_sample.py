"""What moving horizon estimation does with one sample."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import UNROLL
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.arrival import Arrival, Leaving
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.kalman import ekf
from backsight.estimators.kalman.prediction import predict
from backsight.estimators.mhe._starts import from_both_sides
from backsight.estimators.mhe._verdict import verdict_of_window
from backsight.estimators.mhe._window import linearise
from backsight.estimators.parts.filtering import (
    choose,
    data_inputs,
    physical,
    physical_innovation,
)
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.stages import covariance_of, equations_among
from backsight.estimators.parts.substeps import within_bounds, within_bounds_of_many
from backsight.estimators.parts.window import (
    empty_queue,
    moved_on,
    no_window,
    queued,
    unless_broken,
)
from backsight.estimators.scaled import Setting
from backsight.solvers.box import GaussNewton
from backsight.solvers.trajectory import Chain, iterated, mistaken, smoothed
from backsight.types import Array

SMALL = 1e-10
"""Residuals below this are rounding errors and are put out as this."""


@dataclasses.dataclass(frozen=True)
class Parts:
    """An estimator fitted to a model.

    Parameters
    ----------
    s : Setting
        With the hard bounds of the states only.
    walk : (nx, nx) array
        Covariance of the process noise of a sample that the window is not told of.
    chain : Chain
    limits : Limits
    arrival : Arrival
    integrator : Integrator
    optimiser : GaussNewton
    lag : int
    """

    s: Setting
    walk: Array
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
    memory : Memory
    inputs : list
        Memory and data of the sample.
    prior : list
        State and covariance of the newest sample before its measurement.
    data : list
        The newest sample's scaled u, y, mask.
    U, Y, M, present : MX
        The window.
    x_start, spread : MX
        Arrival cost of the window.
    late : MX
        Innovations that wait for the estimate of their sample.
    found : dict
        See `solvers.trajectory.iterated`.
    problem : list
        The last linear problem as `solvers.trajectory.smoothed` takes it; of the active limits
        only the equations, see `equations`.
    P_end : MX
        Covariance of the newest sample in this problem.
    """

    memory: Memory
    inputs: list[ca.MX]
    prior: list[ca.MX]
    data: list[ca.MX]
    U: ca.MX
    Y: ca.MX
    M: ca.MX
    present: ca.MX
    x_start: ca.MX
    spread: ca.MX
    late: ca.MX
    found: dict[str, ca.MX]
    problem: list[ca.MX]
    P_end: ca.MX


def memory(parts: Parts) -> Memory:
    """What is kept from sample to sample."""
    s, samples = parts.s, parts.chain.N + 1
    return Memory(
        x_start=s.x0,
        spread=parts.arrival.spread0,
        x_last=s.x0,
        P_last=parts.chain.stored(s.P0),
        **no_window(s, samples),
        present=np.zeros((1, samples)),
        X=np.tile(s.x0[:, None], samples),
        side=np.zeros((parts.chain.n, samples)),
        late=empty_queue(s, parts.lag),
    )


def solved(parts: Parts) -> Solved:
    """Take a sample into the window and solve it."""
    s, chain, N = parts.s, parts.chain, parts.chain.N
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    m = memory(parts)

    # The window moves on by one sample; the newest one gets the prediction as its guess.
    called, moved = m.present[N], m.present[0]
    U, Y, M, present = moved_on((m.U, m.Y, m.M, m.present), (u, y, mask, 1))
    last = [m.x_last, m.P_last]
    ahead = predict(s, parts.integrator, "discrete")
    prior = choose(called, ahead.call([*last, U[:, N - 1], u]), last)
    guess = ca.horzcat(m.X[:, 1:], within(s)(prior[0], 0))
    tried = ca.horzcat(m.side[:, 1:], m.side[:, N])

    # Gauss-Newton steps, from the guess and the limits that were active a sample ago.
    solver = iterated(
        chain,
        linearise(s, parts.integrator, parts.limits, chain),
        parts.optimiser,
        proximal=parts.arrival.free,
    )
    P_start = parts.arrival.covariance(m.spread)
    given = {"x_bar": m.x_start, "P": P_start, "free": moved, "X": guess, "side": tried}
    found = from_both_sides(s, chain, solver, given | {"U": U, "Y": Y, "M": M, "present": present})

    # The covariance: of the last linear problem without the limits that happen to be active.
    stages = [found[k] for k in chain.sizes]
    free, dropped = equations_among(chain)(found["side"], found["low"], found["high"])
    problem = [found["offset"], P_start, *stages, free, ca.MX.zeros(*free.shape)]
    P_end = covariance_of(chain)(dropped, found["P_end"], *problem)
    if parts.walk.any():
        P_end = mistaken(chain, 0, parts.walk)(*problem)
    return Solved(
        memory=m,
        inputs=[m.symbol, *data],
        prior=prior,
        data=[u, y, mask],
        U=U,
        Y=Y,
        M=M,
        present=present,
        x_start=m.x_start,
        spread=m.spread,
        late=m.late,
        found=found,
        problem=problem,
        P_end=P_end,
    )


def recursion(name: str, parts: Parts) -> Recursion:
    """The estimate of a sample, and the memory for the next one."""
    s, chain, N = parts.s, parts.chain, parts.chain.N
    w = solved(parts)
    found, end = w.found, N - parts.lag
    e, S = ekf.innovation(s)(*w.prior, *w.data)
    newest = physical_innovation(s).call([e, S])
    (e, S), late = queued(w.late, [e, S], parts.lag)
    P = w.P_end
    if parts.lag and parts.walk.any():
        P = mistaken(chain, parts.lag, parts.walk)(*w.problem)
    elif parts.lag:
        P = smoothed(chain, parts.lag)(*w.problem)

    # What leaves the window goes into the arrival cost.
    x_start, spread = choose(
        w.present[0], parts.arrival.advance(w.x_start, w.spread, _leaving(w, chain)),
        [w.x_start, w.spread],
    )  # fmt: skip
    critical = [x_start, spread, found["X"][:, N], w.P_end]
    after = {
        "x_start": x_start, "spread": spread, "x_last": found["X"][:, N], "P_last": w.P_end,
        "U": w.U, "Y": w.Y, "M": w.M, "present": w.present, "X": found["X"],
        "side": found["side"], "late": late,
    }  # fmt: skip
    carry = unless_broken(critical, w.memory.joined(after), w.memory.start)

    course = [found[k] for k in ("conflict", "limit", "open", "rejected")]
    names, infeasible, flags, P = verdict_of_window(parts.chain, parts.s)(
        found["side"][:, end], *course, P, w.prior[1]
    )
    x = within(s)(found["X"][:, end], infeasible)
    outputs = {
        **physical(s, x=x, P=P, u=w.U[:, end], e=e, S=S, flags=flags),
        "iterations": found["iterations"],
        "passes": found["passes"],
        "kkt": ca.fmax(found["residual"], SMALL),
    }
    channels = (*ESTIMATE_CHANNELS, *(Channel(k) for k in ("iterations", "passes", "kkt")))
    if parts.limits.names:
        outputs["infeasible"] = names
        channels = (*channels, Channel("infeasible", ("limit",), labels=parts.limits.names))
    return w.memory.recursion(
        name,
        w.inputs[1:],
        next=carry,
        outputs=outputs,
        channels=channels,
        dt=s.dt,
        lag=parts.lag,
        innovation=ca.Function("newest_innovation", w.inputs, newest) if parts.lag else None,
    )


def _leaving(w: Solved, chain: Chain) -> Leaving:
    stages = [w.found[k] for k in chain.sizes]
    along, X = w.found["along"], w.found["X"]
    return Leaving(
        u=w.U[:, 0],
        u_next=w.U[:, 1],
        y=w.Y[:, 0],
        mask=w.M[:, 0],
        along=along[:, 0],
        along_next=along[:, 1],
        stage=[k[:, 0] for k in stages],
        stage_next=[k[:, 1] for k in stages],
        x_next=X[:, 1],
        P_next=lambda: smoothed(chain, chain.N - 1)(*w.problem),
    )


def within(s: Setting) -> ca.Function:
    """``(x, not) -> x`` set to its hard bounds; with 1 it stays as it is."""
    if s.model.nx > UNROLL:
        x, stays = ca.MX.sym("x", s.model.nx), ca.MX.sym("stays")
        inside = within_bounds_of_many(s, x)
        return ca.Function("within", [x, stays], [ca.if_else(stays, x, inside)])

    def formula(x: ca.SX, stays: ca.SX) -> Results:
        return {"x": ca.if_else(stays, x, within_bounds(s, x))}

    return leaf("within", {**notation(s), "stays": 1}, formula)
