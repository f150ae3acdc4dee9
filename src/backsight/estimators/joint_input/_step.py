"""One sample of the joint input and state filter, for few and for many states.

A force d of which nothing is known is an unknown with infinite variance. It moves the state by G d
before the measurement and shows in it by H d. Minimising the variance among the unbiased estimates
then gives one gain for the forces, M, and one for the states, L = K + (G - K H) M; a force that the
measured rows do not determine has a finite variance instead, which adds to the normal matrix of M.
"""

import casadi as ca
import numpy as np

from backsight.algebra.factor import smallest_pivot, solve_spd
from backsight.algebra.symmetric import vech
from backsight.algebra.update import masked, measured, noise_of
from backsight.engine.dense import (
    UNROLL,
    triangle,
)
from backsight.estimators.joint_input._many import many_gains
from backsight.estimators.joint_input._system import LOST, Forces
from backsight.estimators.parts.covariance import (
    Term,
    congruence,
    symmetric_part,
    times_transposed,
)
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.substeps import within_bounds
from backsight.types import Array


def step(found: Forces) -> ca.Function:
    """Correct with a sample's data and predict.

    ``(x, P, started, u, y, mask)``, of which x is the state before the ramp of an interpolated
    input, started is 1 but at the first sample, and the data have physical units, to ``x_next,
    P_next`` for the coming sample; ``x_post``, its covariance as ``triangle``, all inputs ``v``,
    the innovation ``e`` and its covariance as ``spread``, ``flags``, all scaled; and the forces
    ``d`` with the lower triangle ``d_triangle`` of their covariance, physical. For the smoother,
    scaled: the prior after the ramp ``prior``, the forces ``d_scaled``, and all of the covariance
    of states and forces as ``joint``.
    """
    s, C, Q = found.system.s, _sparse(found.system.C), ca.DM(found.system.s.Q)
    gains = many_gains(found) if s.model.nx > UNROLL else _gains(found)
    ahead, ends = _ahead(found), tail(found)

    def formula(x: Term, P: Term, started: Term, u: Term, y: Term, mask: Term) -> Results:
        known = named_results(gains, x, times_transposed(P, C), started, u, y, mask)
        # The covariance of states and forces together, and that of the states ahead.
        joint = symmetric_part(congruence(known["T"], P, known["V"]))
        triangle, d_triangle = ends(joint)
        kept = ("x_next", "x_post", "v", "e", "spread", "flags", "d", "prior", "d_scaled")
        return {
            "joint": ca.densify(joint),
            "P_next": congruence(ahead, joint, Q),
            "triangle": triangle,
            "d_triangle": d_triangle,
            **{name: known[name] for name in kept},
        }

    return half("joint_input_sample", s, formula, {"started": 1, "u": found.nu})


def _ahead(found: Forces) -> ca.DM:
    """[A, E], or [A, 0] if the forces found have acted already: to the state ahead."""
    E = found.E if found.direct else np.zeros_like(found.E)
    return _sparse(np.hstack([found.system.A, E]))


def tail(found: Forces) -> ca.Function:
    """Lower triangles of the covariances of states, scaled, and of forces, physical."""
    nx, m = found.system.s.model.nx, len(found.names)
    if nx > UNROLL:
        joint = ca.MX.sym("P", nx + m, nx + m)
        kept = [triangle(joint[:nx, :nx]), triangle(joint[nx:, nx:], found.unit)]
        return ca.Function("joint_input_tail", [joint], kept)
    P = ca.SX.sym("P", nx + m, nx + m)
    of_forces = P[nx:, nx:] * ca.SX(np.outer(found.unit, found.unit))
    return ca.Function("joint_input_tail", [P], [vech(P[:nx, :nx]), vech(of_forces)])


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


def _gains(found: Forces) -> ca.Function:
    """Everything but products with P.

    ``(x, P C', started, u, y, mask)`` to the results of `step`, and T and V in the covariance
    T P T' + V of states and forces.
    """
    system, s, m = found.system, found.system.s, len(found.names)
    nx, nu = s.model.nx, found.nu
    A, C, F = _sparse(system.A), _sparse(system.C), ca.SX(found.H)
    B, ramp, D = (_sparse(k[:, :nu]) for k in (system.B, system.B_next, system.D))

    def formula(x: ca.SX, PCt: ca.SX, started: ca.SX, u: ca.SX, y: ca.SX, mask: ca.SX) -> Results:
        # 1. innovation of a motion without forces
        u, y = u / s.su[:nu], y / s.sy
        prior = x + started * ca.mtimes(ramp, u)
        missed = y - ca.mtimes(C, prior) - ca.mtimes(D, u)

        # Before the first sample no force has acted on the prior.
        acted = ca.SX(1) if found.direct else started
        G = ca.SX.zeros(nx, m) if found.direct else started * ca.SX(found.E)
        now = corrected(found, PCt, C=ca.SX(C), H=F, G=G, acted=acted, missed=missed, mask=mask)
        free, d = prior + now["L"] @ now["innovation"], now["d"]
        x_post, flags = settled_forces(found, free, now["lost"] * acted)

        # 5. prediction
        x_next = ca.mtimes(A, x_post) + ca.mtimes(B, u)
        if found.direct:
            x_next += ca.SX(found.E) @ d
        force = d * ca.SX(found.unit)
        return {
            "x_next": x_next,
            "x_post": x_post,
            "d": force,
            "d_scaled": d,
            "prior": prior,
            "v": ca.vertcat(u, force / s.su[nu:]),
            "e": measured(mask) * missed,
            "spread": vech(ca.densify(ca.SX(C) @ PCt + noise_of(ca.SX(s.R), mask))),
            "flags": flags,
            "T": now["T"],
            "V": now["V"],
        }

    sizes = {**notation(s), "PCt": (nx, s.model.ny), "started": 1, "u": nu}
    return leaf("joint_input_gains", sizes, formula)


def corrected(
    found: Forces,
    PCt: ca.SX,
    *,
    C: ca.SX,
    H: ca.SX,
    G: ca.SX,
    acted: ca.SX,
    missed: ca.SX,
    mask: ca.SX,
) -> dict[str, ca.SX]:
    """Forces ``d``, the gain ``L`` of the states and the ``innovation`` of the measured rows.

    ``lost`` is 1 if these rows do not determine the forces. T and V are those of the covariance
    T P T' + V of states and forces.

    Parameters
    ----------
    found : Forces
    PCt : (nx, ny)
        P C' before the measurement.
    C, H : (ny, nx), (ny, m)
        What states and forces show.
    G : (nx, m)
        By what the forces have moved the state before the measurement.
    acted : number
        0 if no force has acted yet.
    missed, mask : (ny,)
        Measurement minus its prediction without forces, and which rows were measured.
    """
    nx, m = G.shape
    s = found.system.s
    Cm, e, R = masked(C, missed, ca.SX(s.R), mask)

    # 2. forces, with the smallest variance among the unbiased estimates
    shown = acted * ca.diag(mask) @ H
    seen = PCt @ ca.diag(mask)
    S = Cm @ seen + R
    K = solve_spd(S, seen.T).T
    W = solve_spd(S, shown)
    lost = lost_forces(acted * ca.diag(measured(mask)) @ H, found.H)
    M = solve_spd(shown.T @ W + lost * ca.SX(np.linalg.inv(found.spread)), W.T)

    # 3. gain of the states, which leaves the forces out of the innovation
    L = K + (G - K @ shown) @ M

    # 4. covariance T P T' + V of states and forces
    T = ca.vertcat(ca.SX.eye(nx) - L @ Cm, -M @ Cm)
    noise = ca.vertcat(L, M)
    left = lost * ca.vertcat(G - L @ shown, ca.SX.eye(m) - M @ shown)
    V = noise @ R @ noise.T + left @ ca.SX(found.spread) @ left.T
    return {
        "d": M @ e,
        "L": L,
        "innovation": e,
        "lost": lost,
        "T": ca.densify(T),
        "V": ca.densify(V),
    }


def settled_forces(found: Forces, free: ca.SX, unobserved: ca.SX) -> tuple[ca.SX, ca.SX]:
    """State within its bounds, and flags."""
    inside = within_bounds(found.system.s, free)
    clipped = ca.if_else(ca.norm_1(inside - free) > 0, 1, 0)
    return inside, Flags(clipped=clipped, unobserved=unobserved).vector()


def lost_forces(H: ca.SX, complete: Array) -> ca.SX:
    """1 if the measured rows of H do not determine the forces, else 0; columns of length one."""
    known = smallest_pivot(ca.SX(complete.T @ complete))
    told = ca.fmin(smallest_pivot(H.T @ H) / known, ca.mmin(ca.diag(H.T @ H)))
    return ca.if_else(told < LOST, 1, 0)
