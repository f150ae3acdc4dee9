"""Steps of the forward pass for many states: covariances are whole matrices, products are loops.

See `smoother`; a covariance is stored as a vector of ``nx * nx`` numbers.
"""

import casadi as ca

from backsight.engine.dense import add_product, symmetrise, transpose
from backsight.engine.loops import iterate
from backsight.solvers.trajectory._imposed import decided, limited_noise, limited_sizes
from backsight.solvers.trajectory.chain import Chain, Stage


def dense_transit(chain: Chain) -> ca.Function:
    """See `backsight.solvers.trajectory.smoother.transit`."""
    nx = chain.nx
    delta, vP = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P)
    stage = [ca.MX.sym(k, size) for k, size in chain.inputs.items()]
    d, variances, z = ca.SX.sym("delta", nx), ca.SX.sym("variances", nx), Stage.of(chain)
    w, Qw, K, nu, conflict = limited_noise(chain, z)
    size = limited_sizes(chain, z, variances, Qw)
    mean = ca.SX(chain.F, z.F) @ d + z.c + w
    leaf = ca.Function(
        "dense_mean", [d, variances, *z.symbols], [mean, ca.densify(Qw), size, K, nu, conflict]
    )
    d_next, Q, *limited = leaf(delta, vP[:: nx + 1], *stage)
    P, F = ca.reshape(vP, nx, nx), ca.MX(chain.F, stage[0])
    half = transpose(add_product(ca.MX.zeros(nx, nx), P, F))
    P_next = symmetrise(add_product(Q, half, F))
    return ca.Function("dense_transit", [delta, vP, *stage], [d_next, ca.vec(P_next), *limited])


def dense_update(chain: Chain) -> ca.Function:
    """See `backsight.solvers.trajectory.smoother.update`."""
    nx, n, ny = chain.nx, chain.n, chain.ny
    delta, vP = ca.MX.sym("delta", nx), ca.MX.sym("P", chain.size_P)
    size, nu_w, bad = (ca.MX.sym(k, n) for k in ("size", "nu", "conflict"))
    K_w = ca.MX.sym("K", nx, n)
    stage = [ca.MX.sym(k, length) for k, length in chain.inputs.items()]
    A, H, e = ca.MX(chain.A, stage[5]), ca.MX(chain.H, stage[3]), stage[4]
    x, P = delta, ca.reshape(vP, nx, nx)
    gains, nus, gs, conflicts = [], [], [], []
    for r in range(n):
        row = [K_w[:, r], nu_w[r], ca.MX(0), bad[r]]
        if not chain.noise[r].any():
            x, P, *row = _limit(chain, r)(x, P, ca.densify(A[r, :]).T, size[r], *stage)
        for kept, value in zip((gains, nus, gs, conflicts), row, strict=True):
            kept.append(value)
    outputs = []
    for j in range(ny):
        x, P, *row = _channel(nx)(x, P, ca.densify(H[j, :]).T, e[j])
        outputs.append(row)
    K_y, nu_y, g_y = (ca.vertcat(ca.MX(0, 1), *k) for k in zip(*outputs, strict=True))
    limits = [ca.vertcat(ca.MX(0, 1), *k) for k in (gains, nus, gs)]
    return ca.Function(
        "dense_update",
        [delta, vP, size, K_w, nu_w, bad, *stage],
        [x, ca.vec(symmetrise(P)), *limits, K_y, nu_y, g_y,
         ca.vertcat(ca.MX(0, 1), *conflicts), size],
    )  # fmt: skip


def _channel(nx: int) -> ca.Function:
    """A scalar update with unit noise: ``(x, P, h', e) -> (x, P, K, nu, g)``."""
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", nx, nx)
    row, e = ca.MX.sym("row", nx), ca.MX.sym("e")
    h, v, d, r = ca.SX.sym("h", nx), ca.SX.sym("v", nx), ca.SX.sym("d", nx), ca.SX.sym("r")
    g = 1 / (ca.dot(h, v) + 1)
    nu = (r - ca.dot(h, d)) * g
    leaf = ca.Function("dense_gain", [h, v, d, r], [d + v * nu, v * g, nu, g])
    v_ = add_product(ca.MX.zeros(nx, 1), P, row.T)
    x_next, K, nu_, g_ = leaf(row, v_, x, e)
    return ca.Function(
        "dense_channel", [x, P, row, e], [x_next, _joseph(P, row, v_, K, K), K, nu_, g_]
    )


def _joseph(P: ca.MX, row: ca.MX, v: ca.MX, K: ca.MX, rK: ca.MX) -> ca.MX:
    """(I - K a') P (I - K a')' + K r K', given v = P a."""
    left = add_product(P, -K, v)
    return add_product(left, rK - add_product(ca.MX.zeros(K.numel(), 1), left, row.T), K)


def _limit(chain: Chain, r: int) -> ca.Function:
    """Limit r on the state; without a multiplier nothing is computed where it is not active."""
    nx = chain.nx
    x, P = ca.MX.sym("x", nx), ca.MX.sym("P", nx, nx)
    row, size = ca.MX.sym("row", nx), ca.MX.sym("size")
    stage = [ca.MX.sym(k, length) for k, length in chain.inputs.items()]
    a, v, d, s, z = *(ca.SX.sym(k, nx) for k in "avd"), ca.SX.sym("s"), Stage.of(chain)
    g, nu, wrong = decided(chain, z, r, variance=ca.dot(a, v), value=ca.dot(a, d), size=s)
    leaf = ca.Function("dense_decided", [a, v, d, s, *z.symbols], [d + v * nu, v * g, nu, g, wrong])
    v_ = add_product(ca.MX.zeros(nx, 1), P, row.T)
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
