"""A limit that is active, as an exact measurement of what it limits."""

import casadi as ca

from backsight.algebra.symmetric import unvech, vech
from backsight.solvers.trajectory.chain import ROOM, Chain, Stage, constant


def symmetric(P: ca.SX) -> ca.SX:
    """Fill the upper triangle from the lower one."""
    return unvech(vech(P))


def decided(
    chain: Chain, z: Stage, r: int, *, variance: ca.SX, value: ca.SX, size: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """One over the variance of an active limit r, its innovation divided by that, and conflict.

    The first is 0 if it is not active, or has no room to move; the second is then the multiplier
    that is given.
    """
    S = variance + chain.softness[r]
    active, e = z.active(r), z.target(r) - value
    room = ROOM * (size + chain.softness[r]) < S
    on = ca.logic_and(active, room)
    g = ca.if_else(on, 1 / ca.if_else(on, S, 1), 0)
    wrong = ca.logic_and(active, ca.logic_and(ca.logic_not(room), ca.fabs(e) > chain.slack[r]))
    return g, ca.if_else(active, e * g, z.force[r]), wrong


def impose(
    chain: Chain, z: Stage, r: int, x: ca.SX, P: ca.SX, a: ca.SX, size: ca.SX
) -> tuple[ca.SX, ...]:
    """Set a'x to limit r if it is active: ``x, P, K, nu, g, conflict``."""
    v = P @ a
    g, nu, wrong = decided(chain, z, r, variance=ca.dot(a, v), value=ca.dot(a, x), size=size)
    K = v * g
    left = P - K @ v.T
    P_next = symmetric(left - (left @ a - chain.softness[r] * K) @ K.T)
    if chain.softness[r] == 0 and a.nnz() == 1:
        i = a.sparsity().row()[0]
        free = ca.if_else(g > 0, 0, 1)
        P_next[i, :] = free * P_next[i, :]
        P_next[:, i] = free * P_next[:, i]
    return x + v * nu, P_next, K, nu, g, wrong


def limited_noise(chain: Chain, z: Stage) -> tuple[ca.SX, ...]:
    """Noise of a transition with its active limits: ``w, Q, K, nu, conflict``."""
    w, Q = ca.SX.zeros(chain.nx), chain.moving_noise(z.before)
    K, nu, conflict = ca.SX.zeros(chain.nx, chain.n), ca.SX.zeros(chain.n), ca.SX.zeros(chain.n)
    for r in range(chain.n):
        if chain.noise[r].any():
            a, size = constant(chain.noise[r]), z.before[0] * noise_variance(chain, r)
            w, Q, K[:, r], nu[r], _, conflict[r] = impose(chain, z, r, w, Q, a, size)
    return w, Q, K, nu, conflict


def noise_variance(chain: Chain, r: int) -> float:
    """Variance of a limited sum of the noise."""
    return float(chain.noise[r] @ chain.Q @ chain.noise[r])


def limited_sizes(chain: Chain, z: Stage, variances: ca.SX, Q: ca.SX) -> ca.SX:
    """Variances of the limited quantities after a transition, before anything cancels."""
    F, A = ca.SX(chain.F, z.F), ca.SX(chain.A, z.A)
    found = ca.SX.zeros(chain.n)
    for r in range(chain.n):
        if chain.noise[r].any():
            found[r] = z.before[0] * noise_variance(chain, r)
        else:
            found[r] = ((A[r, :] @ F) ** 2) @ variances + A[r, :] @ Q @ A[r, :].T
    return found
