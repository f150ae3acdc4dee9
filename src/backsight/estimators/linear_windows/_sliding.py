"""The recursion of a least-squares window from which samples are taken out again."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.linear_windows.stacked import gains, product, stacked
from backsight.estimators.parts import gaussian
from backsight.estimators.parts.filtering import carry_inputs, choose, data_inputs, packed, physical
from backsight.estimators.parts.linear import Linear, predict_packed, without_bounds
from backsight.estimators.parts.window import advance, as_columns, empty_window
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Sliding:
    """What `sliding_window` needs.

    Parameters
    ----------
    system : Linear
        Without process noise.
    N, every, reinitialise : int
        See `RecursiveMHE`.
    L, L_out : (nx, ny) arrays
        Gain of the new sample and of the one that leaves.
    back : (ny, nx) array
        Output at the sample that leaves, per present state.
    """

    system: Linear
    N: int
    every: int
    reinitialise: int
    L: Array
    L_out: Array
    back: Array

    @property
    def span(self) -> int:
        """Age of the sample that leaves."""
        return self.N + self.every


def sliding_window(name: str, w: Sliding) -> Recursion:
    """Kalman filter until the window is full, then batch estimate, then the recursion.

    The covariance is followed exactly: S holds the derivative of the estimate by every
    measurement that may still be taken out, Z the covariance from those that were.
    """
    system, s, n = w.system, w.system.s, w.span + 1
    nx, ny = s.model.nx, s.model.ny
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    memory = {
        "x": s.x0,
        "P": packed(s.P0),
        **empty_window(s, n),
        "S": np.zeros(nx * ny * w.span),
        "Z": np.zeros(nx * (nx + 1) // 2),
        "age": np.zeros(1),
        "called": np.zeros(1),
    }
    symbol, (x, P, *windows, S, Z, age, called) = carry_inputs(list(memory.values()))
    U, Y, M = advance([*as_columns(windows, n)], (u, y, mask))
    prior = choose(called, predict_packed(system).call([x, P, U[:, n - 2], u]), [x, P])
    e, S_e = gaussian.innovation(s)(*prior, u, y, mask)

    kalman = gaussian.correct(without_bounds(s))(*prior, u, y, mask)[:2]
    e_out = _leaving(w)(prior[0], _forced(w, U), Y[:, 0], U[:, 0], M[:, 0])
    x_next, Phi, entered, left = _recur(w)(prior[0], e, mask, e_out, M[:, 0])
    columns = ca.reshape(S, nx, ny * w.span)
    inner = ny * (w.span - 1)
    (P_in,), (kept,) = scan(
        _age(system),
        w.span - 1,
        carry=[_spread(system)(entered)],
        xs=[columns[:, :inner]],
        constants=[Phi],
    )
    Z_next, P_next = _fold(system)(Z, P_in, columns[:, inner:], Phi, left)
    running = [x_next, P_next, ca.vec(ca.horzcat(entered, kept)), Z_next]

    fixed = gains(system, w.N, every=w.every)
    recent = n - w.N - 1
    batch = product(fixed.M, ca.vec(Y[:, recent:])) + product(fixed.N_u, ca.vec(U[:, recent:]))
    fresh = [batch, ca.MX(packed(fixed.P)), ca.MX(_sensitivities(w, fixed.M)), 0 * Z]
    start, go, age_next = _decide(w)(M[:, recent:], age)
    results = choose(start, fresh, choose(go, running, [*kalman, 0 * S, 0 * Z]))
    carry = [*results[:2], *map(ca.vec, (U, Y, M)), *results[2:], age_next, 1]
    outputs = physical(s, ())(*results[:2], u, e, S_e, ca.MX(0, 1))
    return Recursion(
        step=ca.Function(name, [symbol, *data], [ca.vertcat(*carry), *outputs]),
        carry0=np.concatenate(list(memory.values())),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )


def _forced(w: Sliding, U: ca.MX) -> ca.MX:
    """Part of the present state that the inputs since the leaving sample have made."""
    return product(stacked(w.system, w.span).F[-len(w.L) :], ca.vec(U))


def _leaving(w: Sliding) -> ca.Function:
    """Residual of the sample that leaves, 0 if it was not measured."""
    nx, ny, nu = len(w.L), *w.system.D.shape
    x, forced = ca.SX.sym("x", nx), ca.SX.sym("forced", nx)
    y, u, mask = ca.SX.sym("y", ny), ca.SX.sym("u", nu), ca.SX.sym("mask", ny)
    e = y - ca.mtimes(ca.DM(w.back), x - forced) - ca.mtimes(ca.DM(w.system.D), u)
    return ca.Function("leaving", [x, forced, y, u, mask], [mask * e])


def _recur(w: Sliding) -> ca.Function:
    """State, transition of its error, and gains that act at this sample."""
    nx, ny = w.L.shape
    x, e, mask = ca.SX.sym("x", nx), ca.SX.sym("e", ny), ca.SX.sym("mask", ny)
    e_out, mask_out = ca.SX.sym("e_out", ny), ca.SX.sym("mask_out", ny)
    into = ca.SX(ca.DM(w.L)) @ ca.diag(mask)
    out = ca.SX(ca.DM(w.L_out)) @ ca.diag(mask_out)
    remaining = ca.SX.eye(nx) - into @ ca.DM(w.system.C) + out @ ca.DM(w.back)
    Phi = remaining @ ca.sparsify(ca.DM(w.system.A))
    x_next = x + ca.mtimes(ca.DM(w.L), e) - ca.mtimes(ca.DM(w.L_out), e_out)
    return ca.Function(
        "recur", [x, e, mask, e_out, mask_out], [x_next, *map(ca.densify, (Phi, into, out))]
    )


def _spread(system: Linear) -> ca.Function:
    S = ca.SX.sym("S", *system.C.T.shape)
    return ca.Function("spread", [S], [vech(S @ ca.SX(system.s.R) @ S.T)])


def _age(system: Linear) -> ca.Function:
    """One measurement becomes a sample older."""
    nx = len(system.A)
    P, Phi = ca.SX.sym("P", nx * (nx + 1) // 2), ca.SX.sym("Phi", nx, nx)
    S = ca.SX.sym("S", *system.C.T.shape)
    older = Phi @ S
    return ca.Function("age", [P, S, Phi], [P + vech(older @ ca.SX(system.s.R) @ older.T), older])


def _fold(system: Linear) -> ca.Function:
    """Take the oldest measurement out: covariance of those outside, and of the estimate."""
    nx = len(system.A)
    Z, P = (ca.SX.sym(n, nx * (nx + 1) // 2) for n in "ZP")
    Phi, out = ca.SX.sym("Phi", nx, nx), ca.SX.sym("out", *system.C.T.shape)
    S = ca.SX.sym("S", *system.C.T.shape)
    rest = Phi @ S - out
    outside = vech(Phi @ unvech(Z) @ Phi.T + rest @ ca.SX(system.s.R) @ rest.T)
    return ca.Function("fold", [Z, P, S, Phi, out], [outside, P + outside])


def _sensitivities(w: Sliding, M: Array) -> Array:
    """Derivatives of the batch estimate by the measurements, the newest first."""
    nx, ny = w.L.shape
    S = np.zeros((nx, ny * w.span))
    for age in range(min(w.N + 1, w.span)):
        S[:, age * ny : (age + 1) * ny] = M[:, (w.N - age) * ny : (w.N - age + 1) * ny]
    return S.ravel(order="F")


def _decide(w: Sliding) -> ca.Function:
    """Whether to start from the batch estimate, whether the recursion runs, its age after that.

    The age counts measured samples from 1 on; 0 means that the recursion has not started.
    """
    M, age = ca.SX.sym("M", len(w.system.C), w.N + 1), ca.SX.sym("age")
    complete = ca.mmin(M[:, :: w.every])
    due = age == 0
    if w.reinitialise:
        due = ca.logic_or(due, age >= w.reinitialise)
    start = ca.logic_and(complete > 0, due)
    older = age + ca.if_else(age > 0, ca.mmax(M[:, w.N]), 0)
    return ca.Function("decide", [M, age], [start, age > 0, ca.if_else(start, 1, older)])
