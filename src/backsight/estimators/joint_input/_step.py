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
    gain_of,
    plus_product,
    product_of,
    transpose,
    triangle,
)
from backsight.estimators.joint_input._system import Forces
from backsight.estimators.parts.covariance import (
    Term,
    congruence,
    matrix_product,
    symmetric_part,
    times_transposed,
)
from backsight.estimators.parts.factors import cholesky, on_top, solve_definite
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, half, leaf, named_results, notation
from backsight.estimators.parts.substeps import within_bounds
from backsight.types import Array

LOST = 1e-6
"""Below this share of what all rows tell of the forces, the measured ones do not tell them."""


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
    gains = _many_gains(found) if s.model.nx > UNROLL else _gains(found)
    ahead, tail = _ahead(found), _tail(found)

    def formula(x: Term, P: Term, started: Term, u: Term, y: Term, mask: Term) -> Results:
        known = named_results(gains, x, times_transposed(P, C), started, u, y, mask)
        # The covariance of states and forces together, and that of the states ahead.
        joint = symmetric_part(congruence(known["T"], P, known["V"]))
        triangle, d_triangle = tail(joint)
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


def _tail(found: Forces) -> ca.Function:
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
        Cm, e, R = masked(ca.SX(C), missed, ca.SX(s.R), mask)

        # 2. forces, with the smallest variance among the unbiased estimates
        # Before the first sample no force has acted on the prior.
        acted = ca.SX(1) if found.direct else started
        G = ca.SX.zeros(nx, m) if found.direct else started * ca.SX(found.E)
        H = acted * ca.diag(mask) @ F
        seen = PCt @ ca.diag(mask)
        S = Cm @ seen + R
        K = solve_spd(S, seen.T).T
        W = solve_spd(S, H)
        lost = lost_forces(acted * ca.diag(measured(mask)) @ F, found.H)
        M = solve_spd(H.T @ W + lost * ca.SX(np.linalg.inv(found.spread)), W.T)
        d = M @ e

        # 3. states, with the gain that leaves the forces out of the innovation
        L = K + (G - K @ H) @ M
        free = prior + L @ e
        x_post = within_bounds(s, free)
        clipped = ca.if_else(ca.norm_1(x_post - free) > 0, 1, 0)

        # 4. covariance T P T' + V of states and forces
        T = ca.vertcat(ca.SX.eye(nx) - L @ Cm, -M @ Cm)
        noise = ca.vertcat(L, M)
        left = lost * ca.vertcat(G - L @ H, ca.SX.eye(m) - M @ H)
        V = noise @ R @ noise.T + left @ ca.SX(found.spread) @ left.T

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
            "flags": Flags(clipped=clipped, unobserved=lost * acted).vector(),
            "T": ca.densify(T),
            "V": ca.densify(V),
        }

    sizes = {**notation(s), "PCt": (nx, s.model.ny), "started": 1, "u": nu}
    return leaf("joint_input_gains", sizes, formula)


def _many_gains(found: Forces) -> ca.Function:
    """`_gains` of many states, as operations on matrices.

    Gains have columns of zeros where nothing was measured, so that C, F and H need no mask.
    """
    system, s, m = found.system, found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    A, C, F, E = (ca.DM(k) for k in (system.A, system.C, found.H, found.E))
    B, ramp, D = (ca.DM(k[:, :nu]) for k in (system.B, system.B_next, system.D))
    symbols = {"x": nx, "PCt": (nx, ny), "started": 1, "u": nu, "y": ny, "mask": ny}

    def scaled(u: ca.SX, y: ca.SX) -> Results:
        return {"u_scaled": u / s.su[:nu], "y_scaled": y / s.sy}

    def weighed(mask: ca.SX, y: ca.SX) -> Results:
        return {"e": measured(mask) * y, "seen": measured(mask)}

    def settled(x: ca.SX) -> Results:
        inside = within_bounds(s, x)
        return {"x_in": inside, "clipped": ca.if_else(ca.norm_1(inside - x) > 0, 1, 0)}

    sizes = {**notation(s), "u": nu}
    enter, weigh, settle = (
        leaf(name, sizes, f)
        for name, f in (("scaled", scaled), ("weighed", weighed), ("settled", settled))
    )
    x, PCt, started, u_given, y_given, mask = (
        ca.MX.sym(k, *(size if isinstance(size, tuple) else (size,))) for k, size in symbols.items()
    )

    # 1. innovation of a motion without forces
    u, y = enter(u_given, y_given)
    prior = x + started * matrix_product(ramp, u)
    missed = y - matrix_product(C, prior) - matrix_product(D, u)
    e, seen = weigh(mask, missed)
    # 2. forces, from the weighted rows of H
    acted = ca.MX(1) if found.direct else started
    G, H = (0 if found.direct else started) * ca.MX(E), acted * ca.MX(F)
    gains, S, N = gain_of(
        on_top([PCt, transpose(H)]), matrix_product(C, PCt), ca.MX(ca.DM(s.R)), mask
    )
    K, HW = gains[:nx, :], gains[nx:, :]
    lost = _lost(found)(acted, seen)
    known = plus_product(lost * ca.MX(ca.DM(np.linalg.inv(found.spread))), HW, H)
    M = solve_definite(known, HW)
    d = product_of(M, e)

    # 3. states, with the gain that leaves the forces out of the innovation
    L = plus_product(K, plus_product(G, K, H, minus=True), M)
    x_post, clipped = settle(prior + product_of(L, e))

    # 4. covariance T P T' + V of states and forces
    both = on_top([L, M])
    stay = ca.MX(ca.DM(np.vstack([np.eye(nx), np.zeros((m, nx))])))
    T = plus_product(stay, both, ca.MX(C), minus=True)
    alone = on_top([ca.densify(G), ca.MX(ca.DM(np.eye(m)))])
    left = lost * plus_product(alone, both, H, minus=True)
    V = product_of(product_of(both, N), both, turned=(False, True))
    V = plus_product(V, product_of(left, ca.MX(ca.DM(found.spread))), left, turned=(False, True))

    # 5. prediction
    x_next = matrix_product(A, x_post) + matrix_product(B, u)
    if found.direct:
        x_next += matrix_product(E, d)
    force = d * ca.DM(found.unit)
    results = {
        "x_next": x_next,
        "x_post": x_post,
        "d": force,
        "d_scaled": d,
        "prior": prior,
        "v": ca.vertcat(u, force / ca.DM(s.su[nu:])),
        "e": e,
        "spread": triangle(S),
        "flags": _raised()(clipped, lost * acted),
        "T": T,
        "V": V,
    }
    given = [x, PCt, started, u_given, y_given, mask]
    return ca.Function(
        "joint_input_gains", given, [ca.densify(v) for v in results.values()],
        [f"i_{k}" for k in symbols], list(results),
    )  # fmt: skip


def _raised() -> ca.Function:
    clipped, unobserved = ca.SX.sym("clipped"), ca.SX.sym("unobserved")
    flags = Flags(clipped=clipped, unobserved=unobserved).vector()
    return ca.Function("raised", [clipped, unobserved], [flags])


def _lost(found: Forces) -> ca.Function:
    """`lost_forces` of many states: ``(acted, seen) -> lost``."""
    m, ny = found.H.shape[1], found.H.shape[0]
    acted, seen = ca.MX.sym("acted"), ca.MX.sym("seen", ny)
    Ft, known = ca.DM(found.H.T), smallest_pivot(ca.SX(ca.DM(found.H.T @ found.H)))
    rows = ca.MX(Ft) * (acted * ca.repmat(seen.T, m, 1))
    told = product_of(rows, ca.MX(Ft), turned=(False, True))
    pivot, size = ca.SX.sym("pivot", m), ca.SX.sym("size", m)
    share = ca.if_else(size > 0, pivot**2 / ca.if_else(size > 0, size, 1), 0)
    least = ca.fmin(ca.mmin(share) / float(known), ca.mmin(size))
    judge = ca.Function("lost", [pivot, size], [ca.if_else(least < LOST, 1, 0)])
    return ca.Function(
        "lost_forces", [acted, seen], [judge(ca.diag(cholesky(told)), ca.diag(told))]
    )


def lost_forces(H: ca.SX, complete: Array) -> ca.SX:
    """1 if the measured rows of H do not determine the forces, else 0; columns of length one."""
    known = smallest_pivot(ca.SX(complete.T @ complete))
    told = ca.fmin(smallest_pivot(H.T @ H) / known, ca.mmin(ca.diag(H.T @ H)))
    return ca.if_else(told < LOST, 1, 0)
