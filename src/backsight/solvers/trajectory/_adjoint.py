"""The backward pass through a linear window: trajectory, multipliers, and the sides of limits."""

import casadi as ca

from backsight.engine.loops import scan
from backsight.solvers.trajectory import many_states
from backsight.solvers.trajectory.chain import VIOLATED, Chain, Stage, constant, naming

COLUMNS = ("x", "eta", "nu", "side", "value", "broken")
"""What the backward pass says of every sample."""


def adjoint(chain: Chain) -> ca.Function:
    r"""Backward pass: ``(enter, *records, *stages, side, force) -> (wrong, residual, ...)``.

    ``wrong`` counts the limits on the wrong side and ``residual`` is the largest error of
    :math:`R^{-1} v` as multiplier of the outputs. Then side by side in columns ``x``, the
    trajectory :math:`\delta_i`; ``eta``, the :math:`\eta_i` of the noise :math:`w_{i-1} = Q \eta_i`
    that led there; ``nu``, the multipliers of the limits; ``side``, on which they should be;
    ``value``, the limited quantities; and ``broken``, 1 for hard limits that are not held, whether
    they were imposed or not. With ``enter = 0`` limits may only be dropped, those without room are
    dropped, too.
    """
    n = chain.N + 1
    enter = ca.MX.sym("enter")
    stacks = [ca.MX.sym(k, size, n) for k, size in (chain.records | chain.inputs).items()]
    (_, wrong, residual), results = scan(
        _backward(chain),
        n,
        carry=[ca.MX.zeros(chain.nx), ca.MX(0), ca.MX(0)],
        xs=stacks,
        constants=[enter],
        backward=True,
    )
    columns = dict(zip(COLUMNS, results, strict=True))
    sums = {"wrong": wrong, "residual": residual}
    return naming("adjoint", [enter, *stacks], sums | columns)


def _backward(chain: Chain) -> ca.Function:
    """One sample of the backward pass; the carry is the adjoint after its update."""
    if chain.dense:
        return many_states.backward_of_many(chain, _told(chain))
    nx, z = chain.nx, Stage.of(chain)
    lam, enter = ca.SX.sym("lam", nx), ca.SX.sym("enter")
    wrong, residual = ca.SX.sym("wrong"), ca.SX.sym("residual")
    past = {k: ca.SX.sym(k, size) for k, size in chain.records.items()}
    d, vP, nu0, g, nu_y0 = (past[k] for k in ("delta", "P", "nu", "g", "nu_y"))
    K, K_y = ca.reshape(past["K"], nx, chain.n), ca.reshape(past["K_y"], nx, chain.ny)
    A, H, F = ca.SX(chain.A, z.A), ca.SX(chain.H, z.H), ca.SX(chain.F, z.F)
    # Given the whole window the mean is x = d + P lam, with lam after the sample's updates.
    x = d + chain.matrix(vP) @ lam
    left, adj = residual, lam
    # Before an update with gain K and innovation nu0 the adjoint is lam + a (nu0 - K' lam): the
    # last output first, then the limits on the state.
    for j in reversed(range(chain.ny)):
        nu_j = nu_y0[j] - ca.dot(K_y[:, j], adj)
        adj = adj + H[j, :].T * nu_j
        left = ca.fmax(left, ca.fabs(nu_j - z.e[j] + H[j, :] @ x))
    nu = ca.SX.zeros(chain.n)
    for r in reversed(range(chain.n)):
        if not chain.noise[r].any():
            nu[r] = nu0[r] - ca.dot(K[:, r], adj)
            adj = adj + A[r, :].T * nu[r]
    # What is left is the adjoint of the transition; with the limits on its noise that of the noise.
    eta = adj
    for r in reversed(range(chain.n)):
        if chain.noise[r].any():
            nu[r] = nu0[r] - ca.dot(K[:, r], eta)
            eta = eta + ca.SX(ca.DM(chain.noise[r])) * nu[r]
    w = chain.noise_along(z.before, eta)
    value = ca.densify(A @ x + constant(chain.noise) @ w)
    side, change = _sides(chain, z, nu, g, value, enter)
    broken = _broken(chain, z, value)
    back = ca.densify(F.T @ adj)
    results = [back, wrong + change, left, x, eta, nu, side, value, broken]
    inputs = [lam, wrong, residual, *past.values(), *z.symbols, enter]
    return ca.Function("backward", inputs, results)


def _told(chain: Chain) -> ca.Function:
    """``(low, high, side, nu, g, value, enter) -> (side, wrong, broken)`` of the limits."""
    z, enter = Stage.of(chain), ca.SX.sym("enter")
    nu, g, value = (ca.SX.sym(k, chain.n) for k in ("nu", "g", "value"))
    side, change = _sides(chain, z, nu, g, value, enter)
    given = [z.low, z.high, z.side, nu, g, value, enter]
    return ca.Function("limits_told", given, [side, change, _broken(chain, z, value)])


def _sides(
    chain: Chain, z: Stage, nu: ca.SX, g: ca.SX, value: ca.SX, enter: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Sides on which the limits should be, and how many are not."""
    side, changes = ca.SX.zeros(chain.n), ca.SX(0)
    for r in range(chain.n):
        if r in chain.exact:
            side[r] = ca.if_else(z.active(r), 1, 0)
            continue
        active, slack = z.active(r), float(chain.slack[r])
        now = ca.if_else(active, z.side[r], 0)
        pulls = ca.logic_or(z.side[r] * nu[r] < 0, ca.logic_and(ca.logic_not(enter), g[r] == 0))
        outside = ca.if_else(
            value[r] < z.low[r] - slack, 1, ca.if_else(value[r] > z.high[r] + slack, -1, 0)
        )
        side[r] = ca.if_else(active, ca.if_else(pulls, 0, z.side[r]), ca.if_else(enter, outside, 0))
        changes += side[r] != now
    return side, changes


def _broken(chain: Chain, z: Stage, value: ca.SX) -> ca.SX:
    """1 for hard limits that are violated by more than rounding."""
    broken = ca.SX.zeros(chain.n)
    for r in range(chain.n):
        if chain.softness[r] == 0:
            excess = ca.fmax(z.low[r] - value[r], value[r] - z.high[r])
            broken[r] = excess > VIOLATED * float(chain.slack[r])
    return broken
