r"""Dual active set method along a trajectory.

Limits are made active one after the other, the most violated first; a multiplier rises until its
limit is met, or until another one becomes zero, whose limit is then dropped. The cost rises in
every pass, so that this ends, whatever depends on whatever. Each pass is two sweeps through the
window, one for the state of the active set and one for its response to the multiplier: no matrix of
all limits is ever formed, and the cost of a pass is linear in the length.

Source: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex
quadratic programs", 1983, doi:10.1007/BF02591962.
"""

import casadi as ca
import numpy as np

from backsight.engine.loops import iterate, scan
from backsight.solvers.trajectory._adjoint import adjoint
from backsight.solvers.trajectory.chain import Chain, by_name, naming
from backsight.solvers.trajectory.smoother import forward_pass

PASSES_PER_LIMIT = 3
"""Passes per limit and sample that are always enough in practice."""

MOST_PASSES = 256
"""Passes in one window; the next one goes on from there."""

FREE = 1e-9
"""Share of a limit's variance below which the active limits leave it no room to move."""

HOLDS = 1e-9
"""Change of a multiplier below which an active limit does not hold the entering one."""

NEVER = 1e300
"""Multiplier that nothing ends."""

BEYOND = 0.5 * 1e4**2
"""Rise of the cost, of a trajectory ten thousand deviations away, from which on limits that
the passes do not get to hold count as contradicting each other."""


def dual(chain: Chain) -> ca.Function:
    """``(delta, P, *stages, side, run) -> (side, conflict, passes, unfinished)``.

    With ``run = 0`` nothing is done and the sides are those given.
    Of the given active limits those that do not pull are dropped first. If limits contradict each
    other, ``conflict`` is 1 for them and no limit is active. The cost of the dual method is a lower
    bound for every trajectory that meets the limits: where rounding hides that they contradict each
    other, so that the method finds no end, it has risen beyond all measure.
    """
    n, m = chain.n, chain.N + 1
    given = chain.window()
    names = ("go", "dropping", "count", "tau", "risen")
    _, dropping, count, tau, risen = numbers = [ca.MX.sym(k) for k in names]
    side, enter, conflict = stacks = [ca.MX.sym(k, n, m) for k in ("side", "enter", "conflict")]

    state, reaction = _sweeps(chain, given, side, enter)
    wrong, nu, kept, value, size = state
    _, rate, _, response, _ = reaction
    rows = [side, enter, nu, rate, value, response, size, *given[-2:]]
    sums, _ = scan(
        _ratios(chain), m, carry=[ca.MX(0)] * 4 + [ca.MX(NEVER)], xs=rows, constants=[tau]
    )
    turns = ca.logic_and(dropping, wrong > 0)
    *decision, rise = _decide()(*sums, turns, tau)
    length, _, drops, blocked = decision
    (_, worst), (side_next, enter_same, conflict_next, outside) = scan(
        _change(chain),
        m,
        carry=[ca.MX(0), ca.MX(0)],
        xs=[*rows, kept, conflict],
        constants=[*decision, tau, turns],
    )
    _, (fresh,) = scan(_choose(chain), m, carry=[ca.MX(0)], xs=[outside], constants=[worst])
    searching = ca.logic_not(ca.logic_or(turns, ca.logic_or(drops, blocked)))
    enter_next = ca.if_else(searching, fresh, enter_same)
    go_next = ca.logic_or(ca.logic_or(turns, drops), ca.logic_and(searching, worst > 0))
    body = ca.Function(
        "dual_pass",
        [*numbers, *stacks, *given],
        [go_next, turns, count + 1, ca.if_else(drops, length, 0), risen + rise,
         side_next, enter_next, conflict_next],
    )  # fmt: skip
    side0, run, zeros = ca.MX.sym("side", n, m), ca.MX.sym("run"), ca.MX.zeros(n, m)
    last = iterate(
        body,
        min(PASSES_PER_LIMIT * n * m + 8, MOST_PASSES),
        carry=[run, ca.MX(1), *[ca.MX(0)] * 3, side0, zeros, zeros],
        constants=given,
    )
    sides, conflicts, unfinished = _ended(chain)(last[0], last[4], *last[5:])
    results = {
        "side": sides, "conflict": conflicts, "passes": last[2], "unfinished": unfinished,
    }  # fmt: skip
    return naming("dual", [*given, side0, run], results)


def _ended(chain: Chain) -> ca.Function:
    """``(unfinished, risen, side, enter, conflict) -> (side, conflict, unfinished)``."""
    n, m = chain.n, chain.N + 1
    unfinished, risen = ca.SX.sym("unfinished"), ca.SX.sym("risen")
    side, enter, conflict = (ca.SX.sym(k, n, m) for k in ("side", "enter", "conflict"))
    never = ca.logic_and(unfinished, risen > BEYOND)
    pulling = ca.fmin(ca.fabs(side) + ca.fabs(enter), 1)
    return ca.Function(
        "dual_ended",
        [unfinished, risen, side, enter, conflict],
        [
            ca.if_else(never, 0, side),
            ca.if_else(never, pulling, conflict),
            ca.if_else(never, 0, unfinished),
        ],
    )


def _sweeps(
    chain: Chain, given: list[ca.MX], side: ca.MX, enter: ca.MX
) -> tuple[list[ca.MX], list[ca.MX]]:
    """What `_sweep` says of the window, and of its response to the entering multiplier alone.

    For the latter all data are zero. Both are passes of one loop, so that the code is there once.
    """
    n, m = chain.n, chain.N + 1
    delta, P, F, c, before, H, e, A, low, high = given
    data = [delta, c, e, low, high, ca.MX.zeros(n, m)]
    zero = [ca.if_else(ca.fabs(k) < np.inf, 0, k) for k in (low, high)]
    alone = [0 * delta, 0 * c, 0 * e, *zero, enter]
    both = [ca.horzcat(a, b) for a, b in zip(data, alone, strict=True)]
    _, results = scan(
        _sweep(chain), 2, carry=[ca.MX(0)], xs=both, constants=[P, F, before, H, A, side]
    )
    pairs = [ca.horzsplit(r, r.shape[1] // 2) for r in results]
    return [first for first, _ in pairs], [second for _, second in pairs]


def _sweep(chain: Chain) -> ca.Function:
    """``(k, data, constants) -> (k, wrong, nu, kept, value, size)``, both as in `_sweeps`."""
    n, m = chain.n, chain.N + 1
    delta, P, F, c, before, H, e, A, low, high = given = chain.window()
    count, side, force = ca.MX.sym("k"), ca.MX.sym("side", n, m), ca.MX.sym("force", n, m)
    records = forward_pass(chain)(*given, side, force)
    found = by_name(adjoint(chain), [ca.MX(0), *records, *given[2:], side, force])
    data, constants = [delta, c, e, low, high, force], [P, F, before, H, A, side]
    results = [count + 1, *(found[k] for k in ("wrong", "nu", "side", "value")), records[9]]
    return ca.Function("dual_sweep", [count, *data, *constants], results)


def _rows(chain: Chain) -> list[ca.SX]:
    names = ("side", "enter", "nu", "rate", "value", "response", "size", "low", "high")
    return [ca.SX.sym(k, chain.n) for k in names]


def _ratio(side: ca.SX, nu: ca.SX, rate: ca.SX, tau: ca.SX) -> ca.SX:
    """Multiplier of the entering limit at which the one of an active limit becomes zero."""
    falling = -side * rate
    drops = ca.logic_and(side != 0, falling > 0)
    return ca.if_else(drops, ca.fmax(side * nu / ca.if_else(drops, falling, 1), tau), NEVER)


def _ratios(chain: Chain) -> ca.Function:
    """Curvature, gap and variance of the entering limit, and the least of the ratios."""
    sums = [ca.SX.sym(k) for k in ("some", "curvature", "gap", "spread", "ratio")]
    some, curvature, gap, spread, ratio = (ca.SX(k) for k in sums)
    side, enter, nu, rate, value, response, size, low, high = rows = _rows(chain)
    tau = ca.SX.sym("tau")
    for r in range(chain.n):
        target = ca.if_else(enter[r] > 0, low[r], high[r])
        enters = enter[r] != 0
        some = ca.fmax(some, enters)
        curvature += ca.if_else(enters, enter[r] * response[r] + chain.softness[r], 0)
        gap += ca.if_else(enters, enter[r] * (target - value[r]), 0)
        spread += ca.if_else(enters, size[r] + chain.softness[r], 0)
        if r not in chain.exact:
            ratio = ca.fmin(ratio, _ratio(side[r], nu[r], rate[r], tau))
    return ca.Function("dual_ratios", [*sums, *rows, tau], [some, curvature, gap, spread, ratio])


def _decide() -> ca.Function:
    """``(sums, turns, tau) -> (length, adds, drops, blocked, rise)``; the cost rises by this."""
    some, curvature, gap, spread, ratio, turns, tau = (
        ca.SX.sym(k) for k in ("some", "curvature", "gap", "spread", "ratio", "turns", "tau")
    )
    room = curvature > FREE * spread
    full = ca.if_else(room, ca.fmax(gap, 0) / ca.if_else(room, curvature, 1), NEVER)
    runs = ca.logic_and(some, ca.logic_not(turns))
    ends = ca.logic_or(full < NEVER, ratio < NEVER)
    adds = ca.logic_and(runs, ca.logic_and(ends, full <= ratio))
    drops = ca.logic_and(runs, ca.logic_and(ends, full > ratio))
    blocked = ca.logic_and(runs, ca.logic_not(ends))
    length = ca.if_else(ca.logic_or(adds, drops), ca.fmin(full, ratio), 0)
    rise = (length - tau) * (gap - (length + tau) * curvature / 2)
    return ca.Function(
        "dual_decide",
        [some, curvature, gap, spread, ratio, turns, tau],
        [length, adds, drops, blocked, ca.if_else(ca.logic_or(adds, drops), rise, 0)],
    )


def _change(chain: Chain) -> ca.Function:
    """One sample's limits after the step, and the violation of those that are not active."""
    so_far = [ca.SX.sym("found"), ca.SX.sym("worst")]
    found, worst = (ca.SX(k) for k in so_far)
    side, enter, nu, rate, value, response, _, low, high = rows = _rows(chain)
    kept, conflict = ca.SX.sym("kept", chain.n), ca.SX.sym("conflict", chain.n)
    length, adds, drops, blocked, tau, turns = rest = [
        ca.SX.sym(k) for k in ("length", "adds", "drops", "blocked", "tau", "turns")
    ]
    sides, outside, bad = (ca.SX.zeros(chain.n) for _ in range(3))
    for r in range(chain.n):
        ratio = NEVER if r in chain.exact else _ratio(side[r], nu[r], rate[r], tau)
        leaves = ca.logic_and(drops, ca.logic_and(ratio <= length, ca.logic_not(found)))
        found = ca.fmax(found, leaves)
        moved = ca.if_else(leaves, 0, side[r]) + ca.if_else(adds, enter[r], 0)
        sides[r] = ca.if_else(blocked, 0, ca.if_else(turns, kept[r], moved))
        at = value[r] + length * response[r]
        low_by, high_by = low[r] - at, at - high[r]
        violation = ca.fmax(low_by, high_by) / float(chain.slack[r])
        signed = ca.if_else(low_by > high_by, violation, -violation)
        free = ca.logic_and(sides[r] == 0, violation > 1) if r not in chain.exact else ca.SX(0)
        outside[r] = ca.if_else(free, signed, 0)
        worst = ca.fmax(worst, ca.fabs(outside[r]))
        held = ca.logic_or(enter[r] != 0, ca.logic_and(side[r] != 0, ca.fabs(rate[r]) > HOLDS))
        bad[r] = ca.if_else(blocked, held, conflict[r])
    return ca.Function(
        "dual_change",
        [*so_far, *rows, kept, conflict, *rest],
        [found, worst, sides, ca.if_else(ca.logic_or(drops, turns), enter, 0), bad, outside],
    )


def _choose(chain: Chain) -> ca.Function:
    """Side of the first limit that is violated most."""
    before, worst = ca.SX.sym("found"), ca.SX.sym("worst")
    found = ca.SX(before)
    outside, enter = ca.SX.sym("outside", chain.n), ca.SX.zeros(chain.n)
    for r in range(chain.n):
        hit = ca.logic_and(ca.fabs(outside[r]) >= worst, ca.logic_not(found))
        hit = ca.logic_and(hit, worst > 0)
        found = ca.fmax(found, hit)
        enter[r] = ca.if_else(hit, ca.sign(outside[r]), 0)
    return ca.Function("dual_choose", [before, outside, worst], [found, enter])
