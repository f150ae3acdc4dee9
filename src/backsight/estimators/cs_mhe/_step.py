"""One sample of the compressive-sensing estimator: move the window, solve it, hand on."""

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.engine.dense import plus_product
from backsight.engine.recursion import Recursion
from backsight.estimators.arrival import SmoothedArrival
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.cs_mhe._along import Along
from backsight.estimators.cs_mhe._arrival import next_covariance
from backsight.estimators.cs_mhe._innovation import innovation_of_window
from backsight.estimators.cs_mhe._shown import NUMBERS, channels, how_it_went, output
from backsight.estimators.cs_mhe._window import (
    Solver,
    WindowSolution,
    begun_before,
    window_motion,
)
from backsight.estimators.cs_mhe.carryover import Carryover, slide
from backsight.estimators.force_estimator import Forced
from backsight.estimators.parts.filtering import choose, physical
from backsight.estimators.parts.leaf import Results, leaf, named_results, notation
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.window import empty_queue, moved_on, queued, unless_broken


def cs_recursion(
    name: str, solver: Solver, carryover: Carryover | None, along: Along | None = None
) -> Recursion:
    """Put a window's beginning, its solution and its memory together.

    `along` linearises the windows of a nonlinear model.
    """
    forced, N, lag = solver.forced, solver.N, solver.lag
    s, nu, nf, ny = forced.system.s, forced.nu, len(forced.names), len(forced.system.C)
    samples = N + 1
    data = [ca.MX.sym(n, k) for n, k in (("u", nu), ("y", ny), ("m", ny))]
    u, y, mask = _enter(forced)(*data)
    m = _memory(solver, carryover, along)
    if along is None:
        e, S = innovation_of_window(forced, samples)(m.x_next, m.P_next, m.absent, u, y, mask)
    else:
        e, S = along.innovation()(m.x_next, m.P_next, u, y, mask)

    # 1. the window moves on; its samples differ from the motion without forces
    U, Y, M = moved_on((m.U, m.Y, m.M), (u, y, mask))
    absent, slid = _counted()(m.absent)
    weights = _weights(solver, carryover, m.mean, m.variance)

    # 2. the problem of eq. 8-14
    trajectory: dict[str, ca.MX] = {}
    if along is None:
        residuals, states, last = window_motion(forced, samples, m.tail.shape[0])(
            m.x_start, absent, m.tail, U, Y, M
        )
        states = ca.horzcat(states, last)
        window = [residuals, M, *solver.ends(states[:, :-1], residuals, M), absent]
        problem = solver.problem_at(u)
        found = solver.solve(window, m.P_start, weights, m.warm, problem)
    else:
        shifted = ca.horzcat(m.forces[:, 1:], ca.MX.zeros(m.forces.shape[0], 1))
        start = [m.x_start, m.P_start, m.warm]
        made = along.solve(m.X[:, 1:], shifted, [absent, m.tail, U, Y, M], start, weights)
        window, problem, found, states = made.window, made.problem, made.found, made.states
        trajectory = {"X": made.X, "forces": made.forces}
    bands = _bands(solver, window, weights, found, m, slid, problem)

    # 3. the estimate, `lag` samples before the end
    here = N - lag
    now = named_results(
        output(forced),
        states[:, here] + found.x[1],
        bands.P,
        U[:, here],
        m.tail[:, here] if m.tail.numel() else ca.MX.zeros(nf),
        bands.forces,
    )
    (e, S), late = queued(m.late, [e, S], lag)
    says = named_results(how_it_went(solver.lam), *found.info)
    estimate = physical(s, x=now["x"], P=now["triangle"], u=now["v"], e=e, S=S, flags=says["flags"])

    # 4. arrival cost, eq. 12, and what the next window expects (Algorithm 1)
    second = states[:, 1] + found.x[0]
    P_second = next_covariance(solver.arrival, s, found.P[0])
    x_start, P_start = choose(slid, [second, P_second], [m.x_start, m.P_start])
    tail = m.tail
    if tail.numel():
        leaving = found.alpha[:, 0] + found.extra[:, 0]
        tail = slide(slid, tail) + slid * begun_before(solver, leaving)
    after = m.joined(
        {
            "x_start": x_start,
            "P_start": P_start,
            "x_next": states[:, samples] + found.x[2],
            "P_next": bands.P_next,
            "U": U,
            "Y": Y,
            "M": M,
            "absent": absent,
            "tail": tail,
            "late": late,
            **_handed_on(solver, carryover, slid, found, m),
            **bands.next,
            **trajectory,
        }
    )
    if along is not None:  # a motion without end is not linearised along again
        after = unless_broken([x_start, ca.vec(P_start), ca.vec(trajectory["X"])], after, m.start)
    return m.recursion(
        name,
        data,
        next=after,
        outputs={
            **estimate,
            **{name: now[name] for name in ("d_hat", "d_raw", "d_std")},
            **{name: says[name] for name in NUMBERS},
            **({"infeasible": found.infeasible} if solver.limits.names else {}),
        },
        channels=(*ESTIMATE_CHANNELS, *channels(forced.names, solver.limits.names)),
        dt=s.dt,
        lag=lag,
    )


def _memory(solver: Solver, carryover: Carryover | None, along: Along | None) -> Memory:
    """What is kept from sample to sample."""
    s, samples = solver.forced.system.s, solver.N + 1
    nf, ny = len(solver.forced.names), len(s.sy)
    atoms, steps = solver.shape
    expected = np.zeros((atoms, steps if carryover else 0))
    once = {"P_once": s.P0} if _counts_again(solver) else {}
    moved = {}
    if along is not None:
        shape = solver.tables.modal, samples
        moved = {"X": np.tile(s.x0[:, None], samples + 1), "forces": np.zeros(shape)}
    return Memory(
        x_start=s.x0,
        P_start=s.P0,
        x_next=s.x0,
        P_next=s.P0,
        U=np.zeros((solver.forced.nu, samples)),
        Y=np.zeros((ny, samples)),
        M=np.zeros((ny, samples)),
        absent=samples,
        tail=np.zeros((nf if solver.shapes.shape[1] > 1 else 0, samples)),
        warm=np.zeros((atoms, steps)),
        mean=expected,
        variance=expected,
        late=empty_queue(s, solver.lag),
        **once,
        **moved,
    )


@dataclasses.dataclass(frozen=True)
class _Bands:
    """Covariances of the state of the output and after the window, forces, and what is kept."""

    P: ca.MX
    P_next: ca.MX
    forces: ca.MX
    next: dict[str, ca.MX]


def _counts_again(solver: Solver) -> bool:
    """Whether the arrival cost knows less of its error than its covariance says."""
    return solver.refits and solver.arrival == SmoothedArrival(naive=True)


def _bands(
    solver: Solver,
    window: Sequence[ca.MX],
    weights: Sequence[ca.MX],
    found: WindowSolution,
    m: Memory,
    slid: ca.MX,
    problem: Sequence[ca.MX],
) -> _Bands:
    """How large the errors are.

    An arrival cost that counts its measurements in every window gives nearly the estimate of one
    that counts them once, and a covariance that is far too small. The covariance that counts them
    once is kept beside, and the window solved with it, too: the error is the one that this window
    has, and how far the two are apart.
    """
    if not _counts_again(solver):
        return _Bands(found.P[1], found.P[2], found.forces, {})
    once = dataclasses.replace(solver, arrival=SmoothedArrival())
    beside = once.solve(list(window), m.P_once, list(weights), found.alpha, problem)
    (P_once,) = choose(slid, [beside.P[0]], [m.P_once])
    apart = _apart(len(solver.forced.names), P_once.shape[0])
    P, forces = apart(found.x[1], beside.x[1], beside.P[1], found.forces, beside.forces)
    return _Bands(P, beside.P[2], forces, {"P_once": P_once})


def _apart(nf: int, nx: int) -> ca.Function:
    """Covariance and forces of one window with the errors of another, and the distance to it."""
    sizes = {"x": (nx, 1), "x_once": (nx, 1), "whole": (nx, nx), "forces": (nf, 3)}
    sizes |= {"forces_once": (nf, 3)}
    x, x_once, whole, forces, forces_once = given = [ca.MX.sym(k, *n) for k, n in sizes.items()]
    by = x - x_once
    apart = (forces[:, 1] - forces_once[:, 1]) ** 2
    spread = plus_product(whole, by, by, turned=(False, True))
    results = [spread, ca.horzcat(forces[:, :2], forces_once[:, 2] + apart)]
    return ca.Function("apart", given, results)


def _enter(forced: Forced) -> ca.Function:
    """Physical to scaled data: (u, y, mask) -> (u, y, mask)."""
    s, nu = forced.system.s, forced.nu

    def formula(u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        return {"u": u / s.su[:nu], "y": y / s.sy, "mask": mask}

    return leaf("enter", {**notation(s), "u": nu}, formula)


def _counted() -> ca.Function:
    """Absent samples after one more has come, and 1 if none is absent."""

    def formula(absent: ca.SX) -> Results:
        left = ca.fmax(absent - 1, 0)
        return {"absent": left, "full": ca.if_else(left > 0, 0, 1)}

    return leaf("counted", {"absent": 1}, formula)


def _weights(
    solver: Solver, carryover: Carryover | None, mean: ca.MX, variance: ca.MX
) -> list[ca.MX]:
    """Priors of the atoms, see `Carryover.weights`."""
    if carryover is not None:
        return carryover.weights(mean, variance, solver.lam)
    nothing = ca.MX(ca.DM(np.zeros(solver.shape)))
    return [ca.MX(ca.DM(np.full(solver.shape, solver.lam))), *[nothing] * 4]


def _handed_on(
    solver: Solver, carryover: Carryover | None, slid: ca.MX, found: WindowSolution, m: Memory
) -> dict[str, ca.MX]:
    """Where the next window starts from, and what it expects, see `Carryover.carry`."""
    if carryover is None:
        return {"warm": slide(slid, found.alpha), "mean": m.mean, "variance": m.variance}
    last = solver.N - 1 + solver.forced.direct
    seen = np.arange(last, last - solver.shape[1], -1, dtype=np.float64)
    warm, mean, variance = carryover.carry(
        slid,
        (found.alpha, found.extra, found.variance),
        m.variance,
        threshold=solver.threshold,
        seen=seen,
    )
    return {"warm": warm, "mean": mean, "variance": variance}
