"""The recursion of a least-squares window from which samples are taken out again."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.engine.loops import scan
from backsight.engine.recursion import Recursion
from backsight.estimators.base import ESTIMATE_CHANNELS
from backsight.estimators.kalman import ekf
from backsight.estimators.kalman.kf import predict_linear
from backsight.estimators.linear_windows.stacked import gains, product, stacked
from backsight.estimators.parts.covariance import (
    Covariance,
    Term,
    congruence,
    influence,
    matrix_product,
    times_transposed,
)
from backsight.estimators.parts.filtering import choose, data_inputs, physical
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, Symmetric, half, leaf, notation
from backsight.estimators.parts.linear import Linear, without_bounds
from backsight.estimators.parts.memory import Memory
from backsight.estimators.parts.window import moved_on, no_window
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
    nx, ny, kept = s.model.nx, s.model.ny, Covariance(s.model.nx)
    data = data_inputs(s)
    u, y, mask = s.enter()(*data)
    m = Memory(
        x=s.x0,
        P=kept.kept(s.P0),
        **no_window(s, n),
        S=np.zeros((nx, ny * w.span)),
        Z=np.zeros(kept.size),
        age=0,
        called=0,
    )
    U, Y, M = moved_on((m.U, m.Y, m.M), (u, y, mask))
    ahead = predict_linear(system).call([m.x, m.P, U[:, n - 2], u])
    prior = choose(m.called, ahead, [m.x, m.P])
    e, S_e = ekf.innovation(s)(*prior, u, y, mask)

    # Until the first full window: a Kalman filter.
    kalman = ekf.correct(without_bounds(s))(*prior, u, y, mask)[:2]

    # The recursion: the new sample enters the sum of squares, the oldest goes out of it.
    e_out = _leaving(w)(prior[0], _forced(w, U), Y[:, 0], U[:, 0], M[:, 0])
    x_next, Phi, entered, left = _recur(w)(prior[0], e, mask, e_out, M[:, 0])
    inner = ny * (w.span - 1)
    (P_in,), (older,) = scan(
        _age(system),
        w.span - 1,
        carry=[_spread(system)(entered)],
        xs=[m.S[:, :inner]],
        constants=[Phi],
    )
    Z_next, P_next = _fold(system)(m.Z, P_in, m.S[:, inner:], Phi, left)
    running = [x_next, P_next, ca.horzcat(entered, older), Z_next]

    # The batch estimate, from which the recursion starts.
    fixed = gains(system, w.N, every=w.every)
    recent = n - w.N - 1
    batch = product(fixed.M, ca.vec(Y[:, recent:])) + product(fixed.N_u, ca.vec(U[:, recent:]))
    fresh = [batch, ca.MX(kept.kept(fixed.P)), ca.MX(_sensitivities(w, fixed.M)), 0 * m.Z]
    start, go, age = _decide(w)(M[:, recent:], m.age)
    others = choose(go, running, [*kalman, 0 * m.S, 0 * m.Z])
    x, P, S, Z = choose(start, fresh, others)
    return m.recursion(
        name,
        data,
        next={
            "x": x, "P": P, "U": U, "Y": Y, "M": M, "S": S, "Z": Z, "age": age, "called": 1,
        },
        outputs=physical(
            s, x=x, P=kept.triangle()(P), u=u, e=e, S=S_e, flags=ca.MX(Flags().vector())
        ),
        channels=ESTIMATE_CHANNELS,
        dt=s.dt,
    )  # fmt: skip


def _forced(w: Sliding, U: ca.MX) -> ca.MX:
    """Part of the present state that the inputs since the leaving sample have made."""
    return product(stacked(w.system, w.span).F[-len(w.L) :], ca.vec(U))


def _leaving(w: Sliding) -> ca.Function:
    """Residual of the sample that leaves, 0 if it was not measured."""
    back, D = ca.DM(w.back), ca.DM(w.system.D)

    def formula(x: ca.SX, forced: ca.SX, y: ca.SX, u: ca.SX, mask: ca.SX) -> Results:
        return {"e": mask * (y - ca.mtimes(back, x - forced) - ca.mtimes(D, u))}

    return leaf("leaving", {**notation(w.system.s), "forced": len(w.L)}, formula)


def _recur(w: Sliding) -> ca.Function:
    """State, transition of its error, and gains that act at this sample."""
    system = w.system

    def acting(x: ca.SX, e: ca.SX, mask: ca.SX, e_out: ca.SX, mask_out: ca.SX) -> Results:
        into = ca.SX(ca.DM(w.L)) @ ca.diag(mask)
        out = ca.SX(ca.DM(w.L_out)) @ ca.diag(mask_out)
        x_next = x + ca.mtimes(ca.DM(w.L), e) - ca.mtimes(ca.DM(w.L_out), e_out)
        return {"x_next": x_next, "into": ca.densify(into), "out": ca.densify(out)}

    act = leaf("act", notation(system.s), acting)
    A, C, back = ca.DM(system.A), ca.DM(system.C), ca.DM(w.back)

    def formula(x: Term, e: Term, mask: Term, e_out: Term, mask_out: Term) -> Results:
        x_next, into, out = act(x, e, mask, e_out, mask_out)
        # (I - L C + L_out back) A
        changed = times_transposed(out, (back @ A).T) - times_transposed(into, (C @ A).T)
        return {"x_next": x_next, "Phi": A + changed, "into": into, "out": out}

    return half("recur", system.s, formula)


def _spread(system: Linear) -> ca.Function:
    """``(columns) -> S R S'``: what measurements with these influences add to the covariance."""
    return half(
        "spread",
        system.s,
        lambda columns: {"P": influence(columns, system.s.R)},
        {"columns": system.C.T.shape},
    )


def _age(system: Linear) -> ca.Function:
    """One measurement becomes a sample older."""

    def formula(P: Term, columns: Term, Phi: Term) -> Results:
        older = matrix_product(Phi, columns)
        return {"P_next": P + influence(older, system.s.R), "older": older}

    return half("age", system.s, formula, {"columns": system.C.T.shape})


def _fold(system: Linear) -> ca.Function:
    """Take the oldest measurement out: covariance of those outside, and of the estimate."""

    def formula(Z: Term, P: Term, columns: Term, Phi: Term, out: Term) -> Results:
        rest = matrix_product(Phi, columns) - out
        outside = congruence(Phi, Z, 0 * system.s.Q) + influence(rest, system.s.R)
        return {"Z_next": outside, "P_next": P + outside}

    nx, shape = len(system.A), system.C.T.shape
    sizes = {"Z": Symmetric(nx), "columns": shape, "out": shape}
    return half("fold", system.s, formula, sizes)


def _sensitivities(w: Sliding, M: Array) -> Array:
    """Derivatives of the batch estimate by the measurements, the newest first."""
    nx, ny = w.L.shape
    S = np.zeros((nx, ny * w.span))
    for age in range(min(w.N + 1, w.span)):
        S[:, age * ny : (age + 1) * ny] = M[:, (w.N - age) * ny : (w.N - age + 1) * ny]
    return S


def _decide(w: Sliding) -> ca.Function:
    """Whether to start from the batch estimate, whether the recursion runs, its age after that.

    The age counts measured samples from 1 on; 0 means that the recursion has not started.
    """

    def formula(M: ca.SX, age: ca.SX) -> Results:
        complete, due = ca.mmin(M[:, :: w.every]), age == 0
        if w.reinitialise:
            due = ca.logic_or(due, age >= w.reinitialise)
        start = ca.logic_and(complete > 0, due)
        older = age + ca.if_else(age > 0, ca.mmax(M[:, w.N]), 0)
        return {"start": start, "runs": age > 0, "age": ca.if_else(start, 1, older)}

    return leaf("decide", {"M": (len(w.system.C), w.N + 1), "age": 1}, formula)
