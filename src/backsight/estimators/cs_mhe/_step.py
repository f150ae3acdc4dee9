"""One sample of the compressive-sensing estimator: move the window, solve it, hand on."""

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.cs_mhe._window import ROUNDING, Solved, Solver, begun_before, motion
from backsight.estimators.cs_mhe.carryover import Carryover, slide
from backsight.estimators.cs_mhe.tables import Forced
from backsight.estimators.parts.filtering import carry_inputs, choose, physical
from backsight.estimators.parts.window import advance, as_columns, empty_queue, queued
from backsight.schema import Status
from backsight.types import Array

RAISED = (Status.ITERATION_LIMIT, Status.DEPENDENT, Status.UNOBSERVED)
"""Meaning of the flags."""

CONSTANT = 1
"""Arrival cost with a covariance that stays."""


def recursion(name: str, solver: Solver, carryover: Carryover | None) -> Recursion:
    """Put a window's beginning, its solution and its memory together."""
    forced, N, lag = solver.forced, solver.N, solver.lag
    s, nu, nf = forced.system.s, forced.nu, len(forced.names)
    (ny, nx), samples = forced.system.C.shape, N + 1
    data = [ca.MX.sym(n, k) for n, k in (("u", nu), ("y", ny), ("m", ny))]
    u, y, mask = _enter(forced)(*data)
    memory = _memory(solver, carryover)
    symbol, parts = carry_inputs(memory)
    x_start, P_start, x_next, P_next, U, Y, M, absent, tail, warm, mean, variance, late = parts

    e, S = _innovation(forced, samples)(x_next, P_next, absent, u, y, mask)
    U, Y, M = advance(tuple(as_columns((U, Y, M), samples)), (u, y, mask))
    absent, slid = _counted()(absent)
    tail = ca.reshape(tail, -1, samples)
    warm, mean, variance = (ca.reshape(v, solver.shape[0], -1) for v in (warm, mean, variance))
    residuals, states, last = motion(forced, samples, tail.shape[0])(x_start, absent, tail, U, Y, M)
    found = solver.solve(
        [residuals, M, absent],
        ca.reshape(P_start, nx, nx),
        _weights(solver, carryover, mean, variance),
        warm,
    )
    here = N - lag
    x, P, v, *forces = _output(forced)(
        states[:, here] + found.x[1],
        found.P[1],
        U[:, here],
        tail[:, here] if tail.numel() else ca.MX.zeros(nf),
        found.forces,
    )
    second = ca.horzcat(states[:, 1:], last)[:, 0] + found.x[0]
    P_second = ca.MX(s.P0.ravel()) if solver.arrival == CONSTANT else ca.vec(found.P[0])
    carry = choose(slid, [second, P_second], [x_start, P_start])
    carry += [last + found.x[2], ca.vec(found.P[2]), *map(ca.vec, (U, Y, M)), absent]
    if tail.numel():
        leaving = found.alpha[:, 0] + found.extra[:, 0]
        carry.append(ca.vec(slide(slid, tail) + slid * begun_before(solver, leaving)))
    carry += map(ca.vec, _handed_on(solver, carryover, slid, found, variance))
    (e, S), late = queued(late, [e, S], lag)
    carry.append(late)
    flags, *numbers = _told(solver.lam)(*found.info)
    estimate = physical(s, RAISED)(x, P, v, e, S, flags)
    return Recursion(
        step=ca.Function(name, [symbol, *data], [ca.vertcat(*carry), *estimate, *forces, *numbers]),
        carry0=np.concatenate(memory),
        channels=(*ESTIMATE_CHANNELS, *_channels(forced.names)),
        dt=s.dt,
        lag=lag,
    )


def _memory(solver: Solver, carryover: Carryover | None) -> list[Array]:
    """What is kept from sample to sample, before the first one."""
    s, samples = solver.forced.system.s, solver.N + 1
    nf, ny = len(solver.forced.names), len(s.sy)
    atoms, steps = solver.shape
    known = atoms * steps if carryover else 0
    return [
        *[s.x0, s.P0.ravel()] * 2,
        *(np.zeros(k * samples) for k in (solver.forced.nu, ny, ny)),
        np.full(1, float(samples)),
        np.zeros(nf * samples if solver.shapes.shape[1] > 1 else 0),
        *(np.zeros(k) for k in (atoms * steps, known, known)),
        empty_queue(s, solver.lag),
    ]


def _channels(names: tuple[str, ...]) -> tuple[Channel, ...]:
    forces = (Channel(n, ("force",), labels=names) for n in ("d_hat", "d_raw", "d_std"))
    return (*forces, *map(Channel, ("nonzeros", "steps", "kkt", "lam_max")))


def _enter(forced: Forced) -> ca.Function:
    """Physical to scaled data: (u, y, mask) -> (u, y, mask)."""
    s, nu = forced.system.s, forced.nu
    u, y, mask = ca.SX.sym("u", nu), ca.SX.sym("y", len(s.sy)), ca.SX.sym("m", len(s.sy))
    return ca.Function("enter", [u, y, mask], [u / s.su[:nu], y / s.sy, mask])


def _innovation(forced: Forced, samples: int) -> ca.Function:
    """Innovation, 0 where not measured, and its covariance.

    ``(x, P, absent, u, y, mask) -> (e, S)``; the state still lacks what an interpolated input adds
    at its end.
    """
    system, nu = forced.system, forced.nu
    nx, ny = len(system.A), len(system.C)
    x, P, absent = ca.SX.sym("x", nx), ca.SX.sym("P", nx * nx), ca.SX.sym("absent")
    u, y, mask = ca.SX.sym("u", nu), ca.SX.sym("y", ny), ca.SX.sym("m", ny)
    C, R = ca.sparsify(ca.DM(system.C)), system.s.R + (forced.F * forced.sigma**2) @ forced.F.T
    ramp = ca.mtimes(ca.sparsify(ca.DM(system.B_next[:, :nu])), u)
    x_prior = x + ca.if_else(absent < samples, ca.densify(ramp), 0)
    D = ca.sparsify(ca.DM(system.D[:, :nu]))
    e = mask * (y - ca.mtimes(C, x_prior) - ca.mtimes(D, u))
    S = ca.mtimes([C, ca.reshape(P, nx, nx), C.T]) + ca.DM(R)
    return ca.Function(
        "innovation", [x, P, absent, u, y, mask], [ca.densify(e), vech(ca.densify(S))]
    )


def _counted() -> ca.Function:
    """Absent samples after one more has come, and 1 if none is absent."""
    absent = ca.SX.sym("absent")
    left = ca.fmax(absent - 1, 0)
    return ca.Function("counted", [absent], [left, ca.if_else(left > 0, 0, 1)])


def _weights(
    solver: Solver, carryover: Carryover | None, mean: ca.MX, variance: ca.MX
) -> list[ca.MX]:
    """Priors of the atoms, see `Carryover.weights`."""
    if carryover is not None:
        return carryover.weights(mean, variance, solver.lam)
    nothing = ca.MX(ca.DM(np.zeros(solver.shape)))
    return [ca.MX(ca.DM(np.full(solver.shape, solver.lam))), *[nothing] * 4]


def _handed_on(
    solver: Solver, carryover: Carryover | None, slid: ca.MX, found: Solved, variance: ca.MX
) -> list[ca.MX]:
    """Where the next window starts from, and what it expects, see `Carryover.carry`."""
    if carryover is None:
        return [slide(slid, found.alpha)]
    last = solver.N - 1 + solver.forced.direct
    seen = np.arange(last, last - solver.shape[1], -1, dtype=np.float64)
    return carryover.carry(
        slid,
        (found.alpha, found.extra, found.variance),
        variance,
        threshold=solver.threshold,
        seen=seen,
    )


def _output(forced: Forced) -> ca.Function:
    """State, lower triangle of its covariance, all inputs, forces.

    ``(x, P, u, tail, forces) -> (x, P, v, d_hat, d_raw, d_std)``
    """
    nx, nu, nf = len(forced.system.A), forced.nu, len(forced.names)
    x, P = ca.SX.sym("x", nx), ca.SX.sym("P", nx, nx)
    u, tail, forces = ca.SX.sym("u", nu), ca.SX.sym("tail", nf), ca.SX.sym("forces", nf, 3)
    kept, raw = forces[:, 0] + tail, forces[:, 1] + tail
    v = ca.vertcat(u, raw / forced.system.s.su[nu:])
    return ca.Function(
        "output",
        [x, P, u, tail, forces],
        [x, vech(P), v, kept, raw, ca.sqrt(forces[:, 2])],
    )


def _told(lam: float) -> ca.Function:
    """Info of the kernel to flags, nonzeros, steps, kkt and lam_max.

    Violations that are mere rounding are not told apart, so that every compiler gives the same.
    """
    info = [ca.SX.sym(n) for n in ("status", "kkt", "steps", "nonzeros", "lam_max", "unobserved")]
    status, kkt, steps, nonzeros, lam_max, unobserved = info
    residual = ca.fmax(kkt / lam, ROUNDING)
    flags = ca.vertcat(status == 1, status == 2, unobserved)
    return ca.Function("told", info, [flags, nonzeros, steps, residual, lam_max])
