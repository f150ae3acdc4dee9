"""The merit of a point on the way to the best trajectory, see `iterated`."""

from typing import Any

import casadi as ca

from backsight.engine.loops import scan
from backsight.solvers.trajectory import many_states
from backsight.solvers.trajectory.chain import Chain, constant


def merit(chain: Chain, proximal: bool) -> ca.Function:
    """Cost, its derivative along the step, sums of the defects, their multipliers, and steps.

    ``(offset, P, free, *stages, eta, dX, eta_next, nu) -> (J, slope, defects, adjoints, steps)``.
    Defects are those of the trajectory, by state, then the violations of hard limits; of adjoints,
    multipliers and steps the largest in the window is meant.
    """
    nx, n, m = chain.nx, chain.n, chain.N + 1
    offset, P, free = ca.MX.sym("offset", nx), ca.MX.sym("P", chain.size_P), ca.MX.sym("free")
    stages = [ca.MX.sym(k, size, m) for k, size in chain.sizes.items()]
    paths = [ca.MX.sym(k, nx, m) for k in ("eta", "dX", "eta_next")]
    eta, _, eta_next = paths
    nu = ca.MX.sym("nu", n, m)
    start = _of_start(chain, proximal)(offset, P, free, eta[:, 0], eta_next[:, 0])
    end, _ = scan(
        _of_sample(chain),
        m,
        carry=[*start, ca.MX.zeros(nx + n), ca.MX.zeros(nx)],
        xs=[*stages, *paths, nu],
    )
    return ca.Function("merit", [offset, P, free, *stages, *paths, nu], end)


def _of_start(chain: Chain, proximal: bool) -> ca.Function:
    """``(offset, P, free, eta, eta_next) -> (J, slope, defects)`` of the first sample."""
    nx, kind = chain.nx, ca.MX if chain.dense else ca.SX
    sizes = {"offset": nx, "P": chain.size_P, "free": 1, "eta": nx, "eta_next": nx}
    given: list[Any] = [kind.sym(k, n) for k, n in sizes.items()]
    offset, P, free, eta, eta_next = given
    moved = many_states.times_stored(P, eta) if chain.dense else chain.matrix(P) @ eta
    dot = many_states.inner if chain.dense else ca.dot
    results = [
        dot(eta, moved) / 2,
        dot(moved, eta_next - eta),
        ca.vertcat(ca.fabs(offset + moved), kind.zeros(chain.n, 1)),
    ]
    if proximal:
        results = [ca.if_else(free, 0, r) for r in results]
    return ca.Function("merit_of_start", given, results)


def _of_sample(chain: Chain) -> ca.Function:
    """Add one sample to the sums of `merit`."""
    if chain.dense:
        return many_states.merit_of_many(chain, _of_limits(chain))
    nx, n = chain.nx, chain.n
    J, slope, nu = ca.SX.sym("J"), ca.SX.sym("slope"), ca.SX.sym("nu", n)
    lengths = {"defects": nx + n, "adjoints": nx + n, "steps": nx}
    sums = [ca.SX.sym(k, length) for k, length in lengths.items()]
    defects, adjoints, steps = sums
    _, c, before, vH, e, vA, low, high = stage = [ca.SX.sym(k, n) for k, n in chain.sizes.items()]
    eta, x, eta_next = paths = [ca.SX.sym(k, nx) for k in ("eta", "dX", "eta_next")]
    noise = constant(chain.noise)
    w, dw = (chain.noise_along(before, k) for k in (eta, eta_next - eta))
    J_next = J + ca.sumsqr(e) / 2 + ca.dot(eta, w) / 2
    slope_next = slope - ca.dot(e, ca.SX(chain.H, vH) @ x) + ca.dot(eta, dw)
    # The noise is Q (lam + a nu): of its adjoint only lam is the multiplier of the defects. Where a
    # limit holds the noise against the data, lam is much larger than the sum.
    lam = eta_next - noise.T @ nu
    change = noise @ dw + ca.SX(chain.A, vA) @ x
    more, steeper, violated = _of_limits(chain)(low, high, noise @ w, change)
    results = [
        J_next + more,
        slope_next + steeper,
        defects + ca.vertcat(ca.fabs(c + w), violated),
        ca.fmax(adjoints, ca.fabs(ca.vertcat(lam, nu))),
        ca.fmax(steps, ca.fabs(x)),
    ]
    return ca.Function("merit_of_sample", [J, slope, *sums, *stage, *paths, nu], results)


def _of_limits(chain: Chain) -> ca.Function:
    """``(low, high, value, change) -> (J, slope, violated)`` of a sample's limits."""
    low, high, value, change = given = [
        ca.SX.sym(k, chain.n) for k in ("low", "high", "value", "change")
    ]
    J, slope, violated = ca.SX(0), ca.SX(0), ca.SX.zeros(chain.n)
    for r in range(chain.n):
        excess = ca.fmin(value[r] - low[r], 0) + ca.fmax(value[r] - high[r], 0)
        if chain.softness[r] == 0:
            violated[r] = ca.fabs(excess)
        else:
            J += excess**2 / (2 * chain.softness[r])
            slope += excess * change[r] / chain.softness[r]
    return ca.Function("merit_of_limits", given, [J, slope, violated])
