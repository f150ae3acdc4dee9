"""Inequalities on a Gaussian: the least-squares problem with any number of limits, in its dual."""

import casadi as ca

from backsight.engine.dense import add_product
from backsight.engine.loops import iterate, scan

PASSES_PER_ROW = 4
"""Largest number of passes per row; each adds or drops one active row."""

FREE = 1e-10
"""Share of a row's variance below which the active rows leave it no room to move."""

SLACK = 1e-9
"""Violations below this share of a row's standard deviation are rounding errors."""


REFINEMENTS = 2
"""Repetitions of the last solution with its own residual, against the rounding of the sweeps."""

NEVER = 1e300
"""Length of a step that nothing ends."""


def limited(n: int) -> ca.Function:
    r"""Multipliers of limits on n linear combinations of a Gaussian.

    ``(M, c, lower, upper, tried) -> (multipliers, active, conflict, infeasible, exhausted)``.

    For :math:`\xi \sim (x, \Sigma)` and rows A with :math:`c = A x`, :math:`M = A \Sigma A'`, the
    minimiser of :math:`\tfrac12 (\xi - x)' \Sigma^{-1} (\xi - x)` with
    :math:`l \le A \xi \le u` is :math:`x + \Sigma A' \lambda`, where

    .. math:: l \le c + M \lambda \le u, \quad
        \lambda_i > 0 \Rightarrow \text{at } l_i, \quad \lambda_i < 0 \Rightarrow \text{at } u_i .

    M may have any rank: rows may depend on each other. It is the dual active set method: rows are
    made active one after the other, the most violated first, and dropped when their multiplier
    would change its sign; every pass adds or drops one, and the cost rises every time, so that it
    ends. M is kept with its active rows swept, so that a pass is a few products of matrix and
    vector. If a violated row cannot move because of the active ones, the limits contradict each
    other: ``infeasible`` is then 1 and ``conflict`` is 1 for the rows concerned.

    M is (n, n); limits may be infinite; rows with ``tried = 1`` are made active first if they are
    violated at all (a warm start). ``active`` is 1 at a lower, -1 at an upper limit, else 0;
    ``exhausted`` is 1 if the passes did not suffice.

    Source: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex
    quadratic programs", 1983, doi:10.1007/BF02591962; sweeps: Beaton 1964.
    """
    vectors = ["c", "lam", "side", "entering", "conflict"]
    carry = [ca.MX.sym("go"), ca.MX.sym("T", n, n), *(ca.MX.sym(v, n) for v in vectors)]
    carry += [ca.MX.sym("sign"), ca.MX.sym("stuck")]
    constants = [ca.MX.sym(v, n) for v in ("low", "high", "tried", "variance")]
    _, T, c, lam, side, entering, conflict, sign, stuck = carry
    low, high, tried, variance = constants

    row, towards, found = _enter(n)(c, side, entering, sign, low, high, tried, variance)
    column = _times(T, row)
    c_next, lam_next, side_next, pivot, direction, entering_next, blocked = _move(n)(
        c, lam, side, row, towards, found, column, low, high, variance
    )
    wrong = _conflict(n)(conflict, row, side, column, blocked, variance)
    left, right = _sweep(n)(pivot, _times(T, pivot), direction)
    go = _continue()(found, blocked)
    after = [go, add_product(T, left, right), c_next, lam_next, side_next, entering_next]
    after += [wrong, towards, ca.fmax(stuck, blocked)]
    body = ca.Function(f"limit_{n}", [*carry, *constants], after)

    given = [ca.MX.sym("M", n, n), *(ca.MX.sym(v, n) for v in ("c", "low", "high", "tried"))]
    unit, spread, c0, low_, high_ = _standard(n)(*given[:4])
    M = _scaled(given[0], unit)
    zeros = ca.MX.zeros(n)
    start = [ca.MX(1), M, c0, zeros, zeros, zeros, zeros, ca.MX(0), ca.MX(0)]
    last = iterate(
        body,
        PASSES_PER_ROW * n + 8,
        carry=start,
        constants=[low_, high_, given[4], spread],
    )
    go, T_end, _, lam, side, _, conflict, _, stuck = last
    for _ in range(REFINEMENTS):
        lam = _refine(n)(lam, _times(T_end, _residual(n)(c0, _times(M, lam), side, low_, high_)))
    return ca.Function(f"limited_{n}", given, [_product(n)(unit, lam), side, conflict, stuck, go])


def _standard(n: int) -> ca.Function:
    """Factors that give every row the variance 1 (0 if it has none), and the rows in that unit."""
    M, c, low, high = ca.SX.sym("M", n, n), *(ca.SX.sym(v, n) for v in ("c", "low", "high"))
    variance = ca.diag(M)
    some = variance > 0
    unit = 1 / ca.sqrt(ca.if_else(some, variance, 1))
    results = [unit, ca.if_else(some, 1, 0), unit * c, unit * low, unit * high]
    return ca.Function("standard", [M, c, low, high], results)


def _scaled(M: ca.MX, unit: ca.MX) -> ca.MX:
    """diag(unit) M diag(unit), column by column."""
    n = M.shape[0]
    count, column, factor, of_rows = (
        ca.SX.sym(v, k) for v, k in zip("kcfr", (1, n, 1, n), strict=True)
    )
    body = ca.Function(
        "scaled_column", [count, column, factor, of_rows], [count + 1, column * factor * of_rows]
    )
    return scan(body, n, carry=[ca.MX(0)], xs=[M, unit.T], constants=[unit])[1][0]


def _product(n: int) -> ca.Function:
    a, b = ca.SX.sym("a", n), ca.SX.sym("b", n)
    return ca.Function("products", [a, b], [a * b])


def _times(T: ca.MX, vector: ca.MX) -> ca.MX:
    return add_product(ca.MX.zeros(T.shape[0], 1), T, vector.T)


def _first(hit: ca.SX) -> ca.SX:
    """Only the first of the entries that are 1."""
    return ca.if_else(ca.cumsum(hit) == 1, hit, 0)


def _enter(n: int) -> ca.Function:
    """Row that is entering: the one of the last pass, else the most violated one, if any."""
    c, side, entering = (ca.SX.sym(v, n) for v in ("c", "side", "entering"))
    low, high, tried, variance = (ca.SX.sym(v, n) for v in ("low", "high", "tried", "variance"))
    sign = ca.SX.sym("sign")
    deviation = ca.sqrt(ca.fmax(variance, 0)) + 1e-12 * (1 + ca.fabs(c))
    below, above = (low - c) / deviation, (c - high) / deviation
    violation = ca.if_else(side == 0, ca.fmax(below, above), 0)
    violation = ca.if_else(violation > SLACK, violation, 0)
    score = ca.if_else(violation > 0, violation + ca.if_else(tried > 0, 1e9, 0), 0)
    worst = ca.mmax(score)
    chosen = _first(ca.if_else(ca.logic_and(score > 0, score >= worst), 1, 0))
    running = ca.sum1(entering) > 0
    row = ca.if_else(running, entering, chosen)
    towards = ca.if_else(running, sign, ca.if_else(ca.dot(chosen, below > above) > 0, 1, -1))
    return ca.Function(
        "enter",
        [c, side, entering, sign, low, high, tried, variance],
        [row, towards, ca.logic_or(running, worst > 0)],
    )


def _move(n: int) -> ca.Function:
    """Raise the entering multiplier until its row is at the limit or another one is zero."""
    names = ("c", "lam", "side", "row", "column", "low", "high", "variance")
    c, lam, side, row, column, low, high, variance = (ca.SX.sym(v, n) for v in names)
    sign, found = ca.SX.sym("sign"), ca.SX.sym("found")
    curvature = ca.dot(row, column)
    room = curvature > FREE * ca.dot(row, variance)
    # The limits of other rows may be infinite, and infinity times zero is not a number.
    gap = ca.sum1(ca.if_else(row > 0, ca.if_else(sign > 0, low - c, c - high), 0))
    full = ca.if_else(room, gap / ca.if_else(room, curvature, 1), NEVER)
    falling = side * sign * column
    drops = ca.logic_and(side != 0, falling > 0)
    ratio = ca.if_else(drops, ca.fmax(lam * side, 0) / ca.if_else(drops, falling, 1), NEVER)
    partial = ca.mmin(ratio)
    blocked = ca.logic_and(found, ca.logic_and(full >= NEVER, partial >= NEVER))
    moves = ca.logic_and(found, ca.logic_not(blocked))
    adds = ca.logic_and(moves, full <= partial)
    removes = ca.logic_and(moves, full > partial)
    step = sign * ca.if_else(moves, ca.fmin(full, partial), 0)
    leaving = ca.if_else(removes, _first(ca.if_else(ratio <= partial, 1, 0)), 0)
    active = ca.if_else(side != 0, 1, 0)
    outputs = [
        c + step * ca.if_else(active, 0, column),
        ca.if_else(leaving > 0, 0, lam + step * (row - ca.if_else(active, column, 0))),
        ca.if_else(leaving > 0, 0, side + ca.if_else(adds, sign, 0) * row),
        ca.if_else(adds, row, leaving),
        ca.if_else(adds, 1, ca.if_else(removes, -1, 0)),
        ca.if_else(removes, row, 0),
        blocked,
    ]
    inputs = [c, lam, side, row, sign, found, column, low, high, variance]
    return ca.Function("move", inputs, outputs)


def _conflict(n: int) -> ca.Function:
    """The blocked row and the active ones that hold it."""
    so_far, row, side, column = (ca.SX.sym(v, n) for v in ("so_far", "row", "side", "column"))
    blocked, variance = ca.SX.sym("blocked"), ca.SX.sym("variance", n)
    share = column**2 * variance
    holds = ca.logic_and(side != 0, share > 1e-18 * ca.dot(row, variance))
    rows = ca.fmax(row, ca.if_else(holds, 1, 0))
    return ca.Function(
        "conflict",
        [so_far, row, side, column, blocked, variance],
        [ca.if_else(blocked, rows, so_far)],
    )


def _sweep(n: int) -> ca.Function:
    r"""Factors of the change of the swept matrix by a pivot, nothing if there is none.

    With the column t of the pivot and d its diagonal entry the change is
    :math:`-v v'/d \mp 2 e e'`, :math:`v = t \mp e`.
    """
    pivot, column, direction = ca.SX.sym("pivot", n), ca.SX.sym("column", n), ca.SX.sym("dir")
    some = direction != 0
    d = ca.if_else(some, ca.dot(pivot, column), 1)
    v = ca.if_else(some, column - direction * pivot, 0)
    left = ca.horzcat(-v / d, -2 * direction * pivot)
    return ca.Function("sweep", [pivot, column, direction], [left, ca.horzcat(v, pivot)])


def _residual(n: int) -> ca.Function:
    """Distance of the active rows from their limits."""
    c, moved, side, low, high = (ca.SX.sym(v, n) for v in ("c", "moved", "side", "low", "high"))
    gap = ca.if_else(side > 0, low - c - moved, ca.if_else(side < 0, high - c - moved, 0))
    return ca.Function("residual", [c, moved, side, low, high], [gap])


def _refine(n: int) -> ca.Function:
    """Add the multipliers of the residual; the swept block of the active rows is -M^-1."""
    lam, change = ca.SX.sym("lam", n), ca.SX.sym("change", n)
    return ca.Function("refine", [lam, change], [ca.if_else(lam != 0, lam - change, 0)])


def _continue() -> ca.Function:
    found, blocked = ca.SX.sym("found"), ca.SX.sym("blocked")
    return ca.Function("continue", [found, blocked], [ca.logic_and(found, ca.logic_not(blocked))])
