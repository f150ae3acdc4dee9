"""The optimum for a guess of the active limits: where the dual active set method begins."""

import casadi as ca

from backsight.engine.loops import iterate
from backsight.solvers.limits._swept import NEVER, each, gather, numbers, sweep, symbols, times

CLEARLY_FREE = 1e-6
"""Share of a row's variance below which it is not worth a guess: the other rows leave it hardly any
room to move."""


def begin(M: ca.MX, tried: ca.MX, limits: list[ca.MX]) -> list[ca.MX]:
    """Optimum for a part of a guess: swept M, sides, multipliers, c there.

    All rows of the guess are swept, and those whose multipliers have the wrong sign are swept out
    again, until there are none. ``limits`` are c, lower and upper limits.
    """
    n = M.shape[0]
    go, T = ca.MX.sym("go"), ca.MX.sym("T", n, n)
    names = ("side", "inside", "lam", "moved", "c", "low", "high")
    side, inside, *_, c, low, high = rows = [ca.MX.sym(name, 1, n) for name in names]
    _, T_next, kept, swept = iterate(_change(n), n + 1, carry=[ca.MX(1), T, side, inside])
    gap = each(gap_at_limit(), [kept, c, low, high, ca.MX.zeros(1, n)])[0]
    lam, moved, right = each(_solved(), [kept, c, gap, times(T_next, gap)])
    (wrong,) = gather(_differ(), [0.0], [kept, right])
    body = ca.Function(
        f"guess_{n}",
        [go, T, *rows],
        [wrong, T_next, right, swept, lam, moved],
    )
    (start,) = each(_finite(), [tried, *limits[1:]])
    zeros = ca.MX.zeros(1, n)
    carry = [ca.MX(1), M, start, zeros, zeros, limits[0]]
    _, T_end, side_end, _, lam_end, moved_end = iterate(body, n + 1, carry=carry, constants=limits)
    return [T_end, side_end, lam_end, moved_end]


def _finite() -> ca.Function:
    """Side of a guess, none where there is no limit."""
    tried, low, high = symbols("tried low high")
    some = ca.if_else(tried > 0, low > -NEVER, ca.logic_and(tried < 0, high < NEVER))
    return ca.Function("finite", [tried, low, high], [ca.if_else(some, ca.sign(tried), 0)])


def _change(n: int) -> ca.Function:
    """Sweep the first row whose side does not agree with being swept; it may have no room."""
    go, T = ca.MX.sym("go"), ca.MX.sym("T", n, n)
    side, inside = ca.MX.sym("side", 1, n), ca.MX.sym("inside", 1, n)
    first, left, direction = gather(_first_change(), [-1.0, 0.0, 0.0], [side, inside])
    T_next, room = sweep(T, first, direction, CLEARLY_FREE)
    rows = each(_changed(), [numbers(n), side, inside], first, direction, room)
    return ca.Function(f"change_{n}", [go, T, side, inside], [left > 1, T_next, *rows])


def _first_change() -> ca.Function:
    number, count, direction, k, side, inside = symbols("number count direction k side inside")
    differs = ca.fabs(side) != inside
    first = ca.logic_and(differs, count == 0)
    results = [
        ca.if_else(first, k, number),
        count + differs,
        ca.if_else(first, 1 - 2 * inside, direction),
    ]
    return ca.Function("first_change", [number, count, direction, k, side, inside], results)


def _changed() -> ca.Function:
    names = symbols("k side inside number direction room")
    k, side, inside, number, direction, room = names
    here = k == number
    results = [
        ca.if_else(ca.logic_and(here, ca.logic_not(room)), 0, side),
        ca.if_else(ca.logic_and(here, room), direction > 0, inside),
    ]
    return ca.Function("changed", names, results)


def _solved() -> ca.Function:
    """Multiplier, moved row, and its side, none if the multiplier has the wrong sign."""
    side, c, gap, product = symbols("side c gap product")
    active = side != 0
    lam = ca.if_else(active, 2 * gap - product, 0)
    moved = c + ca.if_else(active, gap, product)
    right = ca.if_else(lam * side < 0, 0, side)
    return ca.Function("solved", [side, c, gap, product], [lam, moved, right])


def _differ() -> ca.Function:
    """Number of entries that differ; their maximum in a loop makes LLVM 22 stop with an error."""
    so_far, k, a, b = symbols("so_far k a b")
    return ca.Function("differ", [so_far, k, a, b], [so_far + (a != b)])


def gap_at_limit() -> ca.Function:
    """Distance of an active row from its limit."""
    side, c, low, high, shift = symbols("side c low high shift")
    gap = ca.if_else(side > 0, low - c - shift, ca.if_else(side < 0, high - c - shift, 0))
    return ca.Function("gap_at_limit", [side, c, low, high, shift], [gap])
