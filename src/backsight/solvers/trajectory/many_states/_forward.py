"""Steps of the forward pass for many states, see `backsight.solvers.trajectory.smoother`.

A covariance is stored as a vector of ``nx * nx`` numbers.
"""

import casadi as ca
import numpy as np

from backsight.engine.dense import (
    add_product,
    applied,
    cholesky_of,
    plus_product,
    product_of,
    solve_triangular,
    symmetrise,
    transpose,
)
from backsight.engine.loops import iterate
from backsight.solvers.trajectory._imposed import decided, limited_noise
from backsight.solvers.trajectory.chain import Chain, Stage
from backsight.solvers.trajectory.many_states._symbols import SampleMatrices


def transit_of_many(chain: Chain) -> ca.Function:
    """See `backsight.solvers.trajectory.smoother.transit`."""
    nx = chain.nx
    delta, vP, z = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P), SampleMatrices.of(chain)
    Q, w, *limited = noise_of_transition(chain, z)
    d_next = applied(z.F, delta) + z.c + w
    half = transpose(add_product(ca.MX.zeros(nx, nx), ca.reshape(vP, nx, nx), z.F))
    P_next = symmetrise(add_product(Q, half, z.F))
    size = _limited_sizes(chain, z, vP[:: nx + 1], Q)
    return ca.Function(
        "transit_of_many", [delta, vP, *z.symbols], [d_next, ca.vec(P_next), size, *limited]
    )


def noise_of_transition(chain: Chain, z: SampleMatrices) -> tuple[ca.MX, ...]:
    """Noise of a transition with its active limits: ``Q, w, K, nu, conflict``."""
    nx, n = chain.nx, chain.n
    if not chain.noise.any():
        nothing = [ca.MX.zeros(*size) for size in ((nx, 1), (nx, n), (n, 1), (n, 1))]
        parts = enumerate((chain.Q, *chain.parts))
        first, *rest = (z.before[k] * ca.MX(ca.DM(part)) for k, part in parts)
        return sum(rest, first), *nothing
    stage = Stage.of(chain)
    w, Q, *limited = limited_noise(chain, stage)
    leaf = ca.Function("noise_of_many", stage.symbols, [ca.densify(Q), ca.densify(w), *limited])
    return tuple(leaf.call(z.symbols))


def _limited_sizes(chain: Chain, z: SampleMatrices, variances: ca.MX, Q: ca.MX) -> ca.MX:
    """See `backsight.solvers.trajectory._imposed.limited_sizes`."""
    if not chain.n:
        return ca.MX.zeros(0, 1)
    ones = ca.MX.ones(chain.nx, 1)
    moved = add_product(ca.MX.zeros(chain.n, chain.nx), z.A, z.F, turned=False)
    of_state = product_of(moved * moved, variances) + product_of(product_of(z.A, Q) * z.A, ones)
    own = np.einsum("ri,ij,rj->r", chain.noise, chain.Q, chain.noise)
    return of_state + z.before[0] * ca.MX(ca.DM(own))


def update_of_many(chain: Chain) -> ca.Function:
    """See `backsight.solvers.trajectory.smoother.update`; all outputs of a sample at once."""
    nx, n = chain.nx, chain.n
    delta, vP, z = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P), SampleMatrices.of(chain)
    size, nu_w, bad = (ca.MX.sym(k, n) for k in ("size", "nu", "conflict"))
    K_w = ca.MX.sym("K", nx, n)
    x, P = delta, ca.reshape(vP, nx, nx)
    gains, nus, gs, conflicts = [], [], [], []
    for r in range(n):
        row = [K_w[:, r], nu_w[r], ca.MX(0), bad[r]]
        if not chain.noise[r].any():
            x, P, *row = _limit(chain, r)(x, P, z.A[r, :].T, size[r], *z.symbols)
        for kept, value in zip((gains, nus, gs, conflicts), row, strict=True):
            kept.append(value)
    x, P, K_y, nu_y, factor = _outputs(chain)(x, P, *z.symbols)
    limits = [ca.vertcat(ca.MX(0, 1), *k) for k in (gains, nus, gs)]
    return ca.Function(
        "update_of_many",
        [delta, vP, size, K_w, nu_w, bad, *z.symbols],
        [x, ca.vec(P), *limits, ca.vec(K_y), nu_y, ca.vec(factor),
         ca.vertcat(ca.MX(0, 1), *conflicts), size],
    )  # fmt: skip


def _outputs(chain: Chain) -> ca.Function:
    """``(x, P, *stage) -> (x, P, K, S^-1 (e - H x), L)``, where S = L L' = H P H' + I."""
    nx, ny = chain.nx, chain.ny
    x, P, z = ca.MX.sym("x", nx), ca.MX.sym("P", nx, nx), SampleMatrices.of(chain)
    G = add_product(ca.MX.zeros(nx, ny), P, z.H)  # P H'
    HG = add_product(ca.MX.zeros(ny, ny), transpose(G), z.H)
    S = symmetrise(HG) + ca.MX(ca.DM(np.eye(ny)))
    L = cholesky_of(S)
    told = ca.horzcat(transpose(G), z.e - applied(z.H, x))
    white = solve_triangular(L, solve_triangular(L, told), turned=True)
    K, nu = transpose(white[:, :nx]), white[:, nx]
    # Joseph's form (I - K H) P (I - K H)' + K K' as P - K G' - (G - K S) K' with G = P H'.
    left = plus_product(P, K, G, turned=(False, True), minus=True)
    rest = plus_product(G, K, S, minus=True)
    # The transition makes it symmetric to the last bit again.
    after = plus_product(left, rest, K, turned=(False, True), minus=True)
    results = [x + product_of(G, nu), after, K, nu, L]
    return ca.Function("outputs_of_many", [x, P, *z.symbols], results)


def _joseph(P: ca.MX, row: ca.MX, v: ca.MX, K: ca.MX, rK: ca.MX) -> ca.MX:
    """(I - K a') P (I - K a')' + K r K', given v = P a."""
    left = add_product(P, -K, v)
    return add_product(left, rK - product_of(left, row), K)


def _limit(chain: Chain, r: int) -> ca.Function:
    """Limit r on the state; without a multiplier nothing is computed where it is not active."""
    nx = chain.nx
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", nx, nx)
    row, size = ca.MX.sym("row", nx), ca.MX.sym("size")
    stage = [ca.MX.sym(k, length) for k, length in chain.inputs.items()]
    a, v, d, s, z = *(ca.SX.sym(k, nx) for k in "avd"), ca.SX.sym("s"), Stage.of(chain)
    g, nu, wrong = decided(chain, z, r, variance=ca.dot(a, v), value=ca.dot(a, d), size=s)
    leaf = ca.Function("dense_decided", [a, v, d, s, *z.symbols], [d + v * nu, v * g, nu, g, wrong])
    v_ = product_of(P, row)
    x_next, K, nu_, g_, wrong_ = leaf(row, v_, x, size, *stage)
    P_next = _joseph(P, row, v_, K, float(chain.softness[r]) * K)
    go, K0, nu0, g0, wrong0 = (
        ca.MX.sym(k, length)
        for k, length in zip(("go", "K", "nu", "g", "w"), (1, nx, 1, 1, 1), strict=True)
    )
    body = ca.Function(
        "dense_limit",
        [go, x, P, K0, nu0, g0, wrong0, row, size, *stage],
        [ca.MX(0), x_next, P_next, K, nu_, g_, wrong_],
    )
    wanted = ca.Function("dense_wanted", z.symbols, [ca.logic_or(z.active(r), z.force[r] != 0)])(
        *stage
    )
    start = [wanted, x, P, ca.MX.zeros(nx), ca.MX(0), ca.MX(0), ca.MX(0)]
    _, *last = iterate(body, 1, carry=start, constants=[row, size, *stage])
    return ca.Function("dense_limited", [x, P, row, size, *stage], last)
