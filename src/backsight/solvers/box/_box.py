"""Bounds on a Gaussian: the box-constrained least-squares step in its dual form."""

import casadi as ca

from backsight.algebra.factor import solve_spd
from backsight.algebra.symmetric import unvech
from backsight.engine.loops import iterate

BLOCK_PASSES = 8
"""Passes in which all wrong indices change sides at once, before one at a time."""

SINGLE_PASSES = 20
"""Further passes per index; the hardest of many random ill-conditioned problems took 8."""


def dual_active_set(n: int, *, most: int | None = None) -> ca.Function:
    r"""Multipliers of bounds on a Gaussian.

    ``(M, x, lower, upper) -> (multipliers, side, passes, exhausted)``.

    The minimiser of :math:`\tfrac12 (\xi - x)' \Sigma^{-1} (\xi - x)` subject to bounds on n
    entries is :math:`x + \Sigma_{:,b} \lambda`, where with :math:`M = \Sigma_{b,b}`

    .. math:: l \le x_b + M \lambda \le u, \quad
        \lambda_i > 0 \Rightarrow \text{at } l_i, \quad \lambda_i < 0 \Rightarrow \text{at } u_i .

    Imposing an active bound is thus the same as an exact measurement of that entry; nothing is
    ever inverted, and M may be small or singular in directions that cannot move.

    Solved by block principal pivoting: all indices on the wrong side change at once; after
    `BLOCK_PASSES` only the one of least index, which always ends (Murty 1974): in practice
    within `SINGLE_PASSES` times n, although there are :math:`3^n` choices of sides.

    M is given as its lower triangle; ``side`` is 1 at a lower bound, -1 at an upper one, else 0;
    ``exhausted`` is 1 if the passes did not suffice, so that some bound or sign is still violated;
    `most` limits them further.

    Source: Júdice and Pires, "A block principal pivoting algorithm for large-scale strictly
    monotone linear complementarity problems", 1994, doi:10.1016/0305-0548(94)90106-6.
    """
    vM = ca.SX.sym("M", n * (n + 1) // 2)
    x, low, high = ca.SX.sym("x", n), ca.SX.sym("low", n), ca.SX.sym("high", n)
    side, count = ca.SX.sym("side", n), ca.SX.sym("count")
    go, lam = ca.SX.sym("go"), ca.SX.sym("lam", n)

    M = unvech(vM)
    active = side**2
    target = ca.if_else(side > 0, low, ca.if_else(side < 0, high, x))
    D = ca.diag(active)
    system = D @ M @ D + ca.diag(1 - active)
    multipliers = solve_spd(system, active * (target - x))
    moved = x + M @ multipliers
    slack = 1e-12 * (1 + ca.fabs(moved))
    wanted = ca.if_else(
        active > 0,
        ca.if_else(side * multipliers < 0, 0, side),
        ca.if_else(moved < low - slack, 1, ca.if_else(moved > high + slack, -1, 0)),
    )
    wrong = ca.if_else(wanted - side == 0, 0, 1)
    earlier = ca.cumsum(wrong) - wrong
    first = wrong * ca.if_else(earlier == 0, 1, 0)
    change = ca.if_else(count < BLOCK_PASSES, wrong, first)
    body = ca.Function(
        f"pivot_{n}",
        [go, lam, side, count, vM, x, low, high],
        [ca.mmax(wrong), multipliers, side + change * (wanted - side), count + 1],
    )
    names = [("M", n * (n + 1) // 2), ("x", n), ("low", n), ("high", n)]
    constants = [ca.MX.sym(k, size) for k, size in names]
    start = [ca.MX(1), ca.MX.zeros(n), ca.MX.zeros(n), ca.MX(0)]
    limit = most or BLOCK_PASSES + min(3**n, SINGLE_PASSES * n)
    go_out, *found = iterate(body, limit, carry=start, constants=constants)
    return ca.Function(f"dual_active_set_{n}", constants, [*found, go_out])
