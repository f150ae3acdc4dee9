"""The step of the joint input filter for many states, as operations on matrices."""

import casadi as ca
import numpy as np

from backsight.algebra.factor import smallest_pivot
from backsight.algebra.update import measured
from backsight.engine.dense import (
    gain_of,
    plus_product,
    product_of,
    transpose,
    triangle,
)
from backsight.estimators.joint_input._system import LOST, Forces
from backsight.estimators.parts.covariance import (
    matrix_product,
)
from backsight.estimators.parts.factors import cholesky, on_top, solve_definite
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.parts.substeps import within_bounds


def many_gains(found: Forces) -> ca.Function:
    """`gains` of `_step`, for many states, as operations on matrices.

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
