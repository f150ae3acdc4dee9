"""One sample of the joint input and state filter, for few and for many states.

A force d of which nothing is known is an unknown with infinite variance. It moves the state by G d
before the measurement and shows in it by H d. Minimising the variance among the unbiased estimates
then gives one gain for the forces, M, and one for the states, L = K + (G - K H) M; a force that the
measured rows do not determine has a finite variance instead, which adds to the normal matrix of M.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from backsight.algebra.factor import smallest_pivot, solve_spd
from backsight.algebra.symmetric import unvech, vech
from backsight.algebra.update import masked, measured, noise_of
from backsight.engine.dense import add_product, symmetrise, transpose
from backsight.estimators.joint_input._system import Forces
from backsight.estimators.parts.filtering import packed
from backsight.estimators.parts.gaussian import clip
from backsight.estimators.parts.linear import is_large
from backsight.types import Array

LOST = 1e-6
"""Below this share of what all rows tell of the forces, the measured ones do not tell them."""


def covariance0(found: Forces) -> Array:
    """Covariance of the prior as the carry stores it: lower triangle, or all if it is large."""
    P0 = found.system.s.P0
    return P0.ravel() if is_large(found.system) else packed(P0)


def step(found: Forces, symbols: Sequence[ca.MX]) -> tuple[list[ca.MX], list[ca.MX], list[ca.MX]]:
    """Correct with a sample's data and predict.

    Parameters
    ----------
    found : Forces
    symbols : sequence of MX
        State before the ramp of an interpolated input, its covariance, 1 but at the first sample;
        known inputs, outputs and mask in physical units.

    Returns
    -------
    ahead : state and covariance for the coming sample
    estimate : state, lower triangle of its covariance, all inputs, innovation and the lower
        triangle of its covariance, flags of clipping and of forces not determined; scaled
    forces : forces and lower triangle of their covariance, physical units
    """
    gains = _gains(found)
    whole = _by_loops(found, gains) if is_large(found.system) else _straight(found, gains)
    x_next, P_next, x, vP, v, e, S, flags, d, vP_d = whole.call(list(symbols))
    return [x_next, P_next], [x, vP, v, e, S, flags], [d, vP_d]


def _straight(found: Forces, gains: ca.Function) -> ca.Function:
    """All of it as straight-line code on lower triangles."""
    nx = found.system.s.model.nx
    x, P, *rest = _symbols(found, nx * (nx + 1) // 2, ca.SX)
    full = unvech(P)
    x_next, after, d, v, e, S, flags, T, V = gains.call(
        [x, full @ _sparse(found.system.C).T, *rest]
    )
    joint = T @ full @ T.T + V
    ahead = _ahead(found)
    P_next = ahead @ joint @ ahead.T + _sparse(found.system.s.Q)
    tail = _tail(found).call([joint])
    results = [x_next, vech(ca.densify(P_next)), after, tail[0], v, e, S, flags, d, tail[1]]
    return ca.Function("joint_input_sample", [x, P, *rest], results)


def _by_loops(found: Forces, gains: ca.Function) -> ca.Function:
    """The products with P as loops over matrices; P is all of it."""
    nx, m = found.system.s.model.nx, len(found.names)
    ny, nz = found.system.s.model.ny, nx + m
    x, P, *rest = _symbols(found, nx * nx, ca.MX)
    full = ca.reshape(P, nx, nx)
    PCt = add_product(ca.MX.zeros(nx, ny), full, ca.MX(_sparse(found.system.C)))
    x_next, after, d, v, e, S, flags, T, V = gains.call([x, PCt, *rest])
    joint = symmetrise(add_product(V, transpose(add_product(ca.MX.zeros(nx, nz), full, T)), T))
    ahead = ca.MX(_ahead(found))
    half = transpose(add_product(ca.MX.zeros(nz, nx), joint, ahead))
    P_next = symmetrise(add_product(ca.MX(ca.DM(found.system.s.Q)), half, ahead))
    vP, vP_d = _tail(found).call([joint])
    results = [x_next, ca.vec(P_next), after, vP, v, e, S, flags, d, vP_d]
    return ca.Function("joint_input_sample", [x, P, *rest], results)


def _symbols(found: Forces, stored: int, kind: type) -> list:
    m = found.system.s.model
    sizes = {"x": m.nx, "P": stored, "started": 1, "u": found.nu, "y": m.ny, "mask": m.ny}
    return [kind.sym(name, size) for name, size in sizes.items()]


def _ahead(found: Forces) -> ca.DM:
    """[A, E], or [A, 0] if the forces found have acted already: to the state ahead."""
    E = found.E if found.direct else np.zeros_like(found.E)
    return _sparse(np.hstack([found.system.A, E]))


def _tail(found: Forces) -> ca.Function:
    """Lower triangles of the covariances of states, scaled, and of forces, physical."""
    nx, m = found.system.s.model.nx, len(found.names)
    P = ca.SX.sym("P", nx + m, nx + m)
    of_forces = P[nx:, nx:] * ca.SX(np.outer(found.unit, found.unit))
    return ca.Function("joint_input_tail", [P], [vech(P[:nx, :nx]), vech(of_forces)])


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


def _gains(found: Forces) -> ca.Function:
    """Everything but products with P.

    ``(x, P C', started, u, y, mask)`` to the state ahead, the state, the forces, all inputs, the
    innovation and its covariance, the flags, and T and V in the covariance T P T' + V of states and
    forces.
    """
    system, s, m = found.system, found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    x, _, started, u_, y_, mask = _symbols(found, 0, ca.SX)
    PCt = ca.SX.sym("PCt", nx, ny)
    u, y = u_ / s.su[:nu], y_ / s.sy
    A, C, F = _sparse(system.A), _sparse(system.C), ca.SX(found.H)
    B, ramp, D = (_sparse(k[:, :nu]) for k in (system.B, system.B_next, system.D))
    prior = x + started * ca.mtimes(ramp, u)
    missed = y - ca.mtimes(C, prior) - ca.mtimes(D, u)
    # Before the first sample no force has acted on the prior.
    acted = ca.SX(1) if found.direct else started
    G = ca.SX.zeros(nx, m) if found.direct else started * ca.SX(found.E)
    Cm, e, R = masked(ca.SX(C), missed, ca.SX(s.R), mask)
    H = acted * ca.diag(mask) @ F

    seen = PCt @ ca.diag(mask)
    S = Cm @ seen + R
    K = solve_spd(S, seen.T).T
    W = solve_spd(S, H)
    lost = _lost(acted * ca.diag(measured(mask)) @ F, found.H)
    M = solve_spd(H.T @ W + lost * ca.SX(np.linalg.inv(found.spread)), W.T)
    L = K + (G - K @ H) @ M
    d, free = M @ e, prior + L @ e
    after = clip(s, free)
    clipped = ca.if_else(ca.norm_1(after - free) > 0, 1, 0)

    T = ca.vertcat(ca.SX.eye(nx) - L @ Cm, -M @ Cm)
    noise = ca.vertcat(L, M)
    left = lost * ca.vertcat(G - L @ H, ca.SX.eye(m) - M @ H)
    V = noise @ R @ noise.T + left @ ca.SX(found.spread) @ left.T
    ahead = ca.mtimes(A, after) + ca.mtimes(B, u)
    if found.direct:
        ahead += ca.SX(found.E) @ d
    force = d * ca.SX(found.unit)
    inputs = ca.vertcat(u, force / s.su[nu:])
    spread = vech(ca.densify(ca.SX(C) @ PCt + noise_of(ca.SX(s.R), mask)))
    flags = ca.vertcat(clipped, lost * acted)
    estimate = [after, force, inputs, measured(mask) * missed, spread, flags]
    return ca.Function(
        "joint_input_gains",
        [x, PCt, started, u_, y_, mask],
        [ahead, *estimate, ca.densify(T), ca.densify(V)],
    )


def _lost(H: ca.SX, complete: Array) -> ca.SX:
    """1 if the measured rows of H do not determine the forces, else 0; columns of length one."""
    known = smallest_pivot(ca.SX(complete.T @ complete))
    told = ca.fmin(smallest_pivot(H.T @ H) / known, ca.mmin(ca.diag(H.T @ H)))
    return ca.if_else(told < LOST, 1, 0)
