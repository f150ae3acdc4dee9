"""Inequalities on a Gaussian: the least-squares problem with any number of limits, in its dual."""

import casadi as ca
import numpy as np

from backsight.engine.dense import filled_up
from backsight.engine.loops import iterate, scan
from backsight.solvers.limits._guess import begin, gap_at_limit
from backsight.solvers.limits._swept import (
    NEVER,
    each,
    gather,
    inverse,
    numbers,
    sweep,
    symbols,
    times,
    unit_row,
)

PASSES_PER_ROW = 4
"""Largest number of passes per row; each adds or drops one active row."""

FREE = 1e-10
"""Share of a row's variance below which the active rows leave it no room to move."""

SLACK = 1e-9
"""Violations below this share of a row's standard deviation are rounding errors."""

ROUNDING = 1e-12
"""The same as a share of the value itself, for rows that have no deviation."""

REFINEMENTS = 2
"""Repetitions of the last solution with its own residual, against the rounding of the sweeps."""

HOLDS = 1e-18
"""Squared share of an active row in the one that cannot move, from which on it is in conflict."""


def limited(n: int) -> ca.Function:
    r"""Multipliers of limits on n linear combinations of a Gaussian.

    ``(M, c, lower, upper, tried)
    -> (multipliers, side, inverse, conflict, infeasible, exhausted)``.

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

    M is (n, n); limits may be infinite. ``tried`` and ``side`` are 1 at a lower, -1 at an upper
    limit, else 0: a guess, and the answer. The method begins with those of the guess whose
    multipliers have the right sign when they alone are active, which is the optimum for them.
    ``inverse`` (n, n) is that of M in the active rows, and zero elsewhere: with it the active
    limits are exact measurements, :math:`\Sigma - \Sigma A' M_A^{-1} A \Sigma`. ``exhausted`` is 1
    if the passes did not suffice.

    Source: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex
    quadratic programs", 1983, doi:10.1007/BF02591962; sweeps: Beaton 1964.
    """
    given = [ca.MX.sym("M", n, n), *(ca.MX.sym(v, n) for v in ("c", "low", "high", "tried"))]
    full = filled_up(n)
    unit, *rows = _standard(n, full)(*given)
    M = _scaled(given[0], unit, full)
    spread, c, low, high, tried = (r.T for r in rows)
    limits = [c, low, high]
    T, side, lam, moved = begin(M, tried, limits)
    zeros = ca.MX.zeros(1, full)
    last = iterate(
        _pass(full),
        PASSES_PER_ROW * n + 8,
        carry=[ca.MX(1), T, moved, lam, side, zeros, ca.MX(-1), ca.MX(0), ca.MX(0)],
        constants=[low, high, spread],
    )
    go, T, _, lam, side, conflict, _, _, stuck = last
    for _ in range(REFINEMENTS):
        gap = each(gap_at_limit(), [side, *limits, times(M, lam)])[0]
        lam = each(_refine(), [lam, side, gap, times(T, gap)])[0]
    side, conflict = side[:, :n], conflict[:, :n]
    lam, weight = each(_in_units(), [unit.T, lam[:, :n], side])
    results = [lam.T, side.T, inverse(T, weight), conflict.T, stuck, go]
    return ca.Function(f"limited_{n}", given, results)


def _standard(n: int, full: int) -> ca.Function:
    """Factors that give every row the variance 1 (0 if it has none), and the rows in that unit.

    The rows are filled up with some that have no limit.
    """
    M = ca.SX.sym("M", n, n)
    c, low, high, tried = (ca.SX.sym(v, n) for v in ("c", "low", "high", "tried"))
    variance = ca.diag(M)
    some = variance > 0
    unit = 1 / ca.sqrt(ca.if_else(some, variance, 1))
    rows = (ca.if_else(some, 1, 0), unit * c, unit * low, unit * high, tried)
    more = [ca.SX(ca.DM.ones(full - n)) * v for v in (0, 0, -np.inf, np.inf, 0)]
    filled = [ca.densify(ca.vertcat(row, m)) for row, m in zip(rows, more, strict=True)]
    return ca.Function("standard", [M, c, low, high, tried], [unit, *filled])


def _scaled(M: ca.MX, unit: ca.MX, full: int) -> ca.MX:
    """diag(unit) M diag(unit), column by column, and filled up with zeros."""
    n = M.shape[0]
    column, factor, of_rows = (ca.SX.sym(v, k) for v, k in zip("cfr", (n, 1, n), strict=True))
    scaled = ca.densify(ca.vertcat(column * factor * of_rows, ca.SX.zeros(full - n)))
    body = ca.Function("scaled_column", [column, factor, of_rows], [scaled])
    columns = scan(body, n, carry=[], xs=[M, unit.T], constants=[unit])[1][0]
    return ca.horzcat(columns, ca.MX.zeros(full, full - n))


def _in_units() -> ca.Function:
    """Multiplier in the unit of the row, and its factor in the inverse."""
    unit, lam, side = symbols("unit lam side")
    return ca.Function("in_units", [unit, lam, side], [unit * lam, unit * ca.fabs(side)])


def _pass(n: int) -> ca.Function:
    """Make the most violated row active, or drop the first one whose multiplier becomes zero."""
    go, T = ca.MX.sym("go"), ca.MX.sym("T", n, n)
    names = ("c", "lam", "side", "conflict")
    c, lam, side, _ = rows = [ca.MX.sym(v, 1, n) for v in names]
    entering, sign, stuck = state = [ca.MX.sym(v) for v in ("entering", "sign", "stuck")]
    low, high, spread = constants = [ca.MX.sym(v, 1, n) for v in ("low", "high", "spread")]

    found = gather(_worst(), [0.0, -1.0, 0.0, 0.0], [c, side, low, high, spread], entering, sign)
    _, number, towards, gap = found
    column = times(T, unit_row(n, number))
    partial, leaving, curvature = gather(
        _shortest(), [NEVER, -1.0, 0.0], [lam, side, column], number, towards
    )
    step, pivot, direction, running, blocked = _decide()(
        number, towards, gap, partial, leaving, curvature
    )
    moved = each(
        _move(), [numbers(n), *rows, column], number, towards, step, pivot, direction, blocked
    )
    T_next, _ = sweep(T, pivot, direction, 0.0)
    after = [direction != 0, T_next, *moved, running, towards, ca.fmax(stuck, blocked)]
    return ca.Function(f"limit_{n}", [go, T, *rows, *state, *constants], after)


def _worst() -> ca.Function:
    """Row that is entering: the one of the last pass, else the most violated one, if any."""
    found = symbols("score number towards gap")
    row = k, c, side, low, high, spread = symbols("k c side low high spread")
    entering, sign = symbols("entering sign")
    below, above = low - c, c - high
    violation = ca.fmax(below, above)
    rounding = SLACK * spread + ROUNDING * (1 + ca.fabs(c))
    counts = ca.logic_and(side == 0, violation > rounding)
    again = k == entering
    here = ca.if_else(again, NEVER, ca.if_else(counts, violation, 0))
    upwards = ca.if_else(again, sign > 0, below > above)
    better = here > found[0]
    these = [here, k, ca.if_else(upwards, 1, -1), ca.if_else(upwards, below, above)]
    results = [ca.if_else(better, new, old) for new, old in zip(these, found, strict=True)]
    return ca.Function("worst", [*found, *row, entering, sign], results)


def _shortest() -> ca.Function:
    """Step until the first multiplier is zero, its row, and the entering row's own entry."""
    found = partial, leaving, curvature = symbols("partial leaving curvature")
    row = k, lam, side, column = symbols("k lam side column")
    number, towards = symbols("number towards")
    falling = side * towards * column
    drops = falling > 0
    ratio = ca.if_else(drops, ca.fmax(lam * side, 0) / ca.if_else(drops, falling, 1), NEVER)
    better = ratio < partial
    results = [
        ca.if_else(better, ratio, partial),
        ca.if_else(better, k, leaving),
        curvature + ca.if_else(k == number, column, 0),
    ]
    return ca.Function("shortest", [*found, *row, number, towards], results)


def _decide() -> ca.Function:
    """Whether the entering row reaches its limit or another one has to leave before."""
    given = symbols("number towards gap partial leaving curvature")
    number, towards, gap, partial, leaving, curvature = given
    found, room = number >= 0, curvature > FREE
    full = ca.if_else(room, gap / ca.if_else(room, curvature, 1), NEVER)
    stays = ca.logic_and(full >= NEVER, partial >= NEVER)
    moves = ca.logic_and(found, ca.logic_not(stays))
    adds, removes = (ca.logic_and(moves, v) for v in (full <= partial, full > partial))
    results = [
        towards * ca.if_else(moves, ca.fmin(full, partial), 0),
        ca.if_else(adds, number, ca.if_else(removes, leaving, -1)),
        adds - removes,
        ca.if_else(removes, number, -1),
        ca.logic_and(found, stays),
    ]
    return ca.Function("decide", given, results)


def _move() -> ca.Function:
    """A row after a step; in conflict are the row that cannot move and those that hold it."""
    row = k, c, lam, side, conflict, column = symbols("k c lam side conflict column")
    of_all = number, towards, step, pivot, direction, blocked = symbols(
        "number towards step pivot direction blocked"
    )
    active, mine = side != 0, k == number
    drops, adds = (ca.logic_and(k == pivot, v) for v in (direction < 0, direction > 0))
    holds = ca.logic_and(active, column**2 > HOLDS)
    results = [
        c + step * ca.if_else(active, 0, column),
        ca.if_else(drops, 0, lam + step * (mine - ca.if_else(active, column, 0))),
        ca.if_else(drops, 0, side + ca.if_else(adds, towards, 0)),
        ca.if_else(blocked, ca.logic_or(mine, holds), conflict),
    ]
    return ca.Function("move", [*row, *of_all], results)


def _refine() -> ca.Function:
    """Add the multiplier of the gap that is left."""
    lam, side, gap, product = symbols("lam side gap product")
    better = ca.if_else(side != 0, lam + 2 * gap - product, 0)
    return ca.Function("refine", [lam, side, gap, product], [better])
