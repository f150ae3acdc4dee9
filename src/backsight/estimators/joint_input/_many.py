"""The step of the joint input filter for many states, as operations on matrices."""

import casadi as ca
import numpy as np

from backsight.algebra.factor import smallest_pivot
from backsight.algebra.update import measured
from backsight.engine.dense import (
    few_entries,
    gain_of,
    plus_product,
    product_of,
    transpose,
    triangle,
)
from backsight.estimators.joint_input._system import LOST, Forces
from backsight.estimators.parts.covariance import matrix_product
from backsight.estimators.parts.factors import cholesky, on_top, solve_definite
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, named_results, notation
from backsight.estimators.parts.substeps import within_bounds


def many_gains(found: Forces) -> ca.Function:
    """`gains` of `_step`, for many states, as operations on matrices."""
    s = found.system.s
    nx, ny = s.model.nx, s.model.ny
    x, PCt, started = ca.MX.sym("x", nx), ca.MX.sym("PCt", nx, ny), ca.MX.sym("started")
    u, y, mask = ca.MX.sym("u", found.nu), ca.MX.sym("y", ny), ca.MX.sym("mask", ny)
    gains = named_results(many_weights(found), PCt, started, mask)
    known = named_results(many_states(found), x, gains["L"], gains["M"], started, u, y, mask)
    flags = raised()(known.pop("clipped"), gains["unobserved"])
    spread = triangle(gains["S"])
    results = {**known, "spread": spread, "flags": flags, "T": gains["T"], "V": gains["V"]}
    given = {"x": x, "PCt": PCt, "started": started, "u": u, "y": y, "mask": mask}
    return ca.Function(
        "joint_input_gains", list(given.values()), list(results.values()),
        [f"i_{k}" for k in given], list(results),
    )  # fmt: skip


def many_weights(found: Forces) -> ca.Function:
    """What no measurement changes: ``(P C', started, mask) -> (L, M, T, V, S, unobserved)``.

    Gains L of the states and M of the forces, T and V of the covariance T P T' + V of both, and the
    covariance S of the innovation. Gains have columns of zeros where nothing was measured, so that
    C, F and H need no mask.
    """
    s, m = found.system.s, len(found.names)
    nx, ny = s.model.nx, s.model.ny
    C, F, E = (ca.DM(k) for k in (found.system.C, found.H, found.E))
    PCt, started, mask = ca.MX.sym("PCt", nx, ny), ca.MX.sym("started"), ca.MX.sym("mask", ny)
    weights = ca.SX.sym("mask", ny)
    seen = ca.Function("seen", [weights], [ca.densify(measured(weights))])(mask)

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

    # 3. gain of the states, which leaves the forces out of the innovation
    L = plus_product(K, plus_product(G, K, H, minus=True), M)

    # 4. covariance T P T' + V of states and forces
    both = on_top([L, M])
    stay = ca.MX(ca.DM(np.vstack([np.eye(nx), np.zeros((m, nx))])))
    T = plus_product(stay, both, ca.MX(C), minus=True)
    alone = on_top([ca.densify(G), ca.MX(ca.DM(np.eye(m)))])
    left = lost * plus_product(alone, both, H, minus=True)
    V = product_of(product_of(both, N), both, turned=(False, True))
    V = plus_product(V, product_of(left, ca.MX(ca.DM(found.spread))), left, turned=(False, True))
    results = {"L": L, "M": M, "T": T, "V": V, "S": S, "unobserved": lost * acted}
    return ca.Function(
        "joint_input_weights", [PCt, started, mask], [ca.densify(v) for v in results.values()],
        ["PCt", "started", "mask"], list(results),
    )  # fmt: skip


def many_states(found: Forces) -> ca.Function:
    """What a measurement changes: ``(x, L, M, started, u, y, mask)`` to states and forces."""
    system, s, m = found.system, found.system.s, len(found.names)
    nx, ny, nu = s.model.nx, s.model.ny, found.nu
    A, C, E = (ca.DM(k) for k in (few_entries(system.A), system.C, found.E))
    B, ramp, D = (ca.DM(k[:, :nu]) for k in (system.B, system.B_next, system.D))

    def scaled(u: ca.SX, y: ca.SX) -> Results:
        return {"u_scaled": u / s.su[:nu], "y_scaled": y / s.sy}

    def weighed(mask: ca.SX, y: ca.SX) -> Results:
        return {"e": measured(mask) * y}

    def settled(x: ca.SX) -> Results:
        inside = within_bounds(s, x)
        return {"x_in": inside, "clipped": ca.if_else(ca.norm_1(inside - x) > 0, 1, 0)}

    sizes = {**notation(s), "u": nu}
    enter, weigh, settle = (
        leaf(name, sizes, f)
        for name, f in (("scaled", scaled), ("weighed", weighed), ("settled", settled))
    )
    x, L, M = ca.MX.sym("x", nx), ca.MX.sym("L", nx, ny), ca.MX.sym("M", m, ny)
    started, mask = ca.MX.sym("started"), ca.MX.sym("mask", ny)
    u_given, y_given = ca.MX.sym("u", nu), ca.MX.sym("y", ny)

    # 1. innovation of a motion without forces
    u, y = enter(u_given, y_given)
    prior = x + started * matrix_product(ramp, u)
    e = weigh(mask, y - matrix_product(C, prior) - matrix_product(D, u))
    # 2. and 3. forces and states
    d = product_of(M, e)
    x_post, clipped = settle(prior + product_of(L, e))
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
        "clipped": clipped,
    }
    given = {"x": x, "L": L, "M": M, "started": started, "u": u_given, "y": y_given, "mask": mask}
    return ca.Function(
        "joint_input_states", list(given.values()), [ca.densify(v) for v in results.values()],
        [f"i_{k}" for k in given], list(results),
    )  # fmt: skip


def raised() -> ca.Function:
    """``(clipped, unobserved) -> flags``."""
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
