"""The limits that are active along a trajectory.

First all limits on the wrong side change sides at once, in the whole window (block principal
pivoting, Júdice and Pires 1994, doi:10.1016/0305-0548(94)90106-6): two or three passes forward and
backward nearly always do. Where that does not end, or limits depend on each other, the dual active
set method takes over, which always ends (`backsight.solvers.trajectory._dual`).

At the end all limits are looked at, also those that were imposed: where so many are active that
nothing is free any more, rounding can make limits that contradict each other look compatible.
"""

import casadi as ca

from backsight.engine.loops import iterate
from backsight.solvers.trajectory._adjoint import adjoint
from backsight.solvers.trajectory._dual import dual
from backsight.solvers.trajectory.chain import Chain, by_name, naming
from backsight.solvers.trajectory.smoother import filtered

BLOCK_PASSES = 8
"""Passes in which all wrong limits change sides at once."""

RESULTS = ("x", "eta", "nu", "side", "P_end", "conflict", "residual", "passes", "open")
"""Results of `solve`."""


def solve(chain: Chain) -> ca.Function:
    """Build the solver of the linear problem with its limits.

    ``(delta, P, *stages, side) -> (x, eta, nu, side, P_end, conflict, residual, passes, open)``.
    Given is a guess of the active limits. Results are the trajectory, the adjoints of the noise,
    the multipliers of the limits, the active limits, the covariance of the last sample; 1 for
    limits that contradict each other, and then no limit is active; `adjoint`'s residual; the number
    of passes; and 1 if they did not suffice.
    """
    n, m = chain.n, chain.N + 1
    given = chain.window()
    side0 = ca.MX.sym("side", n, m)
    inputs = [*given, side0]
    if not n:
        found = by_name(_sweep(chain), inputs)
        return _solution(inputs, found | {"passes": ca.MX(1), "open": ca.MX(0)})

    # 1. All limits on the wrong side change sides, until there are none.
    body, start = _pivot(chain)
    ends = iterate(body, BLOCK_PASSES, carry=[*start[:2], side0, *start[3:]], constants=given)
    _, passes, _, *swept = ends
    found = dict(zip(_sweep(chain).name_out(), swept, strict=True))
    failed = _any(chain)(found["conflict"], found["broken"], found["wrong"])

    # 2. Where that did not end well: one after the other.
    go, side, bad, count, unfinished = _symbols(chain)
    once = ca.Function(
        "dual_instead",
        [go, side, bad, count, unfinished, *inputs],
        [ca.MX(0), *_after_dual(chain, inputs, count)],
    )
    zeros = ca.MX.zeros(n, m)
    _, side, bad, passes, unfinished = iterate(
        once, 1, carry=[failed, found["side"], zeros, passes, ca.MX(0)], constants=inputs
    )

    # 3. The trajectory of these limits; without any if some are still not held.
    body = _settle(chain)
    kept = [found[k] for k in KEPT]
    _, side, bad, *kept = iterate(
        body, 2, carry=[failed, side, bad, *kept], constants=[unfinished, *given]
    )
    found = dict(zip(KEPT, kept, strict=True))
    course = {"side": side, "conflict": bad, "passes": passes, "open": unfinished}
    return _solution(inputs, found | course)


KEPT = ("x", "eta", "nu", "P_end", "residual")
"""What is kept of the results of `_sweep`."""


def _solution(inputs: list[ca.MX], found: dict[str, ca.MX]) -> ca.Function:
    return naming("solve", inputs, {k: found[k] for k in RESULTS})


def _symbols(chain: Chain) -> list[ca.MX]:
    """Whether to go on, sides, limits in conflict, number of passes, whether there were too few."""
    n, m = chain.n, chain.N + 1
    sizes = {"go": (1, 1), "side": (n, m), "bad": (n, m), "count": (1, 1), "unfinished": (1, 1)}
    return [ca.MX.sym(k, *size) for k, size in sizes.items()]


def _sweep(chain: Chain) -> ca.Function:
    """One pass forward and backward with given sides, see `filtered` and `adjoint`.

    ``(delta, P, *stages, side)`` to `KEPT`, and ``conflict``, ``broken`` and ``wrong``.
    """
    n, m = chain.n, chain.N + 1
    given = chain.window()
    side, force = ca.MX.sym("side", n, m), ca.MX.zeros(n, m)
    records = by_name(filtered(chain), [*given, side, force])
    back = by_name(adjoint(chain), [ca.MX(1), *records.values(), *given[2:], side, force])
    found = back | {"P_end": records["P"][:, -1], "conflict": records["conflict"]}
    names = (*KEPT, "side", "conflict", "broken", "wrong")
    return naming("sweep", [*given, side], {k: found[k] for k in names})


def _pivot(chain: Chain) -> tuple[ca.Function, list[ca.MX]]:
    """A pass in which all wrong limits change sides, and the carry before it."""
    go, side, _, count, _ = _symbols(chain)
    given = chain.window()
    found = by_name(_sweep(chain), [*given, side])
    old = [ca.MX.sym(k, *v.shape) for k, v in found.items()]
    body = ca.Function(
        "pivot",
        [go, count, side, *old, *given],
        [found["wrong"] > 0, count + 1, found["side"], *found.values()],
    )
    return body, [ca.MX(1), ca.MX(0), side, *(ca.MX.zeros(*k.shape) for k in old)]


def _after_dual(chain: Chain, inputs: list[ca.MX], count: ca.MX) -> list[ca.MX]:
    """Sides, limits in conflict, number of passes and whether they were too few."""
    found = by_name(dual(chain), inputs)
    passes = count + found["passes"]
    return [found["side"], found["conflict"], passes, found["unfinished"]]


def _settle(chain: Chain) -> ca.Function:
    """The trajectory of given sides; if a limit is not held, once more with none of them."""
    n, m = chain.n, chain.N + 1
    go, side, bad, _, unfinished = _symbols(chain)
    given = chain.window()
    found = by_name(_sweep(chain), [*given, side])
    old = [ca.MX.sym(k, *found[k].shape) for k in KEPT]
    again = _contradicts(chain)(found["broken"], side, unfinished, _any(chain)(bad, bad, ca.MX(0)))
    named = ca.if_else(again, ca.fmax(found["broken"], ca.fabs(side)), bad)
    none = ca.if_else(again, ca.MX.zeros(n, m), side)
    return ca.Function(
        "settle",
        [go, side, bad, *old, unfinished, *given],
        [again, none, named, *(found[k] for k in KEPT)],
    )


def _any(chain: Chain) -> ca.Function:
    """1 if one of two marks is set anywhere in the window, or the number is not zero."""
    n, m = chain.n, chain.N + 1
    a, b, number = ca.SX.sym("a", n, m), ca.SX.sym("b", n, m), ca.SX.sym("number")
    marked = ca.fmax(ca.mmax(ca.vec(a)), ca.mmax(ca.vec(b)))
    return ca.Function("any", [a, b, number], [ca.fmin(marked + number, 1)])


def _contradicts(chain: Chain) -> ca.Function:
    """1 if a limit is not held though the search for the active ones has ended."""
    n, m = chain.n, chain.N + 1
    broken, side = ca.SX.sym("broken", n, m), ca.SX.sym("side", n, m)
    unfinished, known = ca.SX.sym("unfinished"), ca.SX.sym("known")
    some = ca.logic_and(ca.mmax(ca.vec(broken)) > 0, ca.mmax(ca.vec(ca.fabs(side))) > 0)
    excused = ca.logic_or(unfinished, known)
    return ca.Function(
        "contradicts", [broken, side, unfinished, known],
        [ca.logic_and(some, ca.logic_not(excused))],
    )  # fmt: skip
