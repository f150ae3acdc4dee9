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
from backsight.solvers.trajectory.smoother import forward_pass

BLOCK_PASSES = 8
"""Passes in which all wrong limits change sides at once."""

RESULTS = ("x", "eta", "nu", "side", "P_end", "conflict", "residual", "passes", "open")
"""Results of `solve`."""


def solve(chain: Chain, *, most: int | None = None) -> ca.Function:
    """Build the solver of the linear problem with its limits.

    ``(delta, P, *stages, side) -> (x, eta, nu, side, P_end, conflict, residual, passes, open)``.
    Given is a guess of the active limits. Results are the trajectory, the adjoints of the noise,
    the multipliers of the limits, the active limits, the covariance of the last sample; 1 for
    limits that contradict each other, and then no limit is active; `adjoint`'s residual; the number
    of passes; and 1 if they did not suffice. With `most` there are at most so many passes and no
    dual method: limits that contradict each other are then limits that are not held.
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
    block = BLOCK_PASSES if most is None else most
    ends = iterate(body, block, carry=[*start[:2], side0, *start[3:]], constants=given)
    _, passes, _, *swept = ends
    found = dict(zip(_sweep(chain).name_out(), swept, strict=True))
    failed = _any(chain)(found["conflict"], found["broken"], found["wrong"])
    if most is not None:
        none = ca.MX.zeros(n, m)
        return _solution(inputs, found | {"conflict": none, "passes": passes, "open": failed})

    # 2. Where that did not end well: one after the other, from the guess, from none, or without.
    body, before = _attempt(chain)
    zeros, kept = ca.MX.zeros(n, m), [found[k] for k in KEPT]
    carry = [failed, ca.MX(0), side0, found["side"], zeros, passes, ca.MX(0), *kept]
    last = iterate(body, 3, carry=carry, constants=given)
    return _solution(inputs, dict(zip(before, last, strict=True)))


KEPT = ("x", "eta", "nu", "P_end", "residual")
"""What is kept of the results of `_sweep`."""


def _solution(inputs: list[ca.MX], found: dict[str, ca.MX]) -> ca.Function:
    return naming("solve", inputs, {k: found[k] for k in RESULTS})


def _sweep(chain: Chain) -> ca.Function:
    """One pass forward and backward with given sides, see `filtered` and `adjoint`.

    ``(delta, P, *stages, side)`` to `KEPT`, and ``conflict``, ``broken`` and ``wrong``.
    """
    n, m = chain.n, chain.N + 1
    given = chain.window()
    side, force = ca.MX.sym("side", n, m), ca.MX.zeros(n, m)
    records = by_name(forward_pass(chain), [*given, side, force])
    back = by_name(adjoint(chain), [ca.MX(1), *records.values(), *given[2:], side, force])
    found = back | {"P_end": records["P"][:, -1], "conflict": records["conflict"]}
    names = (*KEPT, "side", "conflict", "broken", "wrong")
    return naming("sweep", [*given, side], {k: found[k] for k in names})


def _pivot(chain: Chain) -> tuple[ca.Function, list[ca.MX]]:
    """A pass in which all wrong limits change sides, and the carry before it."""
    go, count, side = ca.MX.sym("go"), ca.MX.sym("count"), ca.MX.sym("side", chain.n, chain.N + 1)
    given = chain.window()
    found = by_name(_sweep(chain), [*given, side])
    old = [ca.MX.sym(k, *v.shape) for k, v in found.items()]
    body = ca.Function(
        "pivot",
        [go, count, side, *old, *given],
        [found["wrong"] > 0, count + 1, found["side"], *found.values()],
    )
    return body, [ca.MX(1), ca.MX(0), side, *(ca.MX.zeros(*k.shape) for k in old)]


def _attempt(chain: Chain) -> tuple[ca.Function, list[str]]:
    """The dual method and the trajectory of its limits, and the names of what it carries.

    The first attempt is from the guess of active limits, which may be more than there is freedom;
    if it finds a contradiction, or a limit that is not held in the end, or no end (limits that
    depend on each other let it go round in circles), the second one is from no active limits; if
    that still leaves a limit that is not held, the third is without limits.
    """
    n, m = chain.n, chain.N + 1
    sizes = {
        "go": (1, 1), "attempt": (1, 1), "start": (n, m), "side": (n, m), "conflict": (n, m),
        "passes": (1, 1), "open": (1, 1),
    }  # fmt: skip
    before = {k: ca.MX.sym(k, *size) for k, size in sizes.items()}
    given = chain.window()
    search = by_name(dual(chain), [*given, before["start"], before["attempt"] < LAST])
    found = by_name(_sweep(chain), [*given, search["side"]])
    judged = _judge(chain)(
        before["attempt"], before["conflict"], search["conflict"],
        search["side"], found["broken"], search["unfinished"], found["conflict"],
    )  # fmt: skip
    go, start, conflict = judged
    old = [ca.MX.sym(k, *found[k].shape) for k in KEPT]
    after = [
        go, before["attempt"] + 1, start, search["side"], conflict,
        before["passes"] + search["passes"], search["unfinished"], *(found[k] for k in KEPT),
    ]  # fmt: skip
    body = ca.Function("attempt", [*before.values(), *old, *given], after)
    return body, [*before, *KEPT]


LAST = 2
"""Attempt without limits."""


def _judge(chain: Chain) -> ca.Function:
    """Whether another attempt is needed, from what active limits, and the limits in conflict.

    Sensors without noise that contradict what is known are left out, whatever the limits are.
    """
    n, m = chain.n, chain.N + 1
    attempt, unfinished = ca.SX.sym("attempt"), ca.SX.sym("unfinished")
    names = ("known", "conflict", "side", "broken", "unmet")
    known, conflict, side, broken, unmet = given = [ca.SX.sym(k, n, m) for k in names]
    side, broken, sensors = ca.SX(side), ca.SX(broken), ca.SX.zeros(n, m)
    for r in chain.exact:
        sensors[r, :] = unmet[r, :]
        side[r, :] = broken[r, :] = ca.SX.zeros(1, m)
    some = [ca.mmax(ca.vec(ca.fabs(k))) for k in (conflict, side, broken)]
    contradicts, held, violated = some
    violated = ca.logic_and(ca.logic_and(violated, held), ca.logic_not(unfinished))
    anew = ca.logic_or(ca.logic_or(contradicts, violated), unfinished)
    again = ca.if_else(attempt == 0, anew, violated)
    named = ca.if_else(violated, ca.fmax(broken, ca.fabs(side)), conflict)
    return ca.Function(
        "judge_attempt",
        [attempt, *given[:4], unfinished, given[4]],
        [
            ca.logic_and(again, attempt < LAST),
            ca.SX.zeros(n, m),
            ca.fmax(ca.if_else(attempt == LAST, known, named), sensors),
        ],
    )


def _any(chain: Chain) -> ca.Function:
    """1 if one of two marks is set anywhere in the window, or the number is not zero."""
    n, m = chain.n, chain.N + 1
    a, b, number = ca.SX.sym("a", n, m), ca.SX.sym("b", n, m), ca.SX.sym("number")
    marked = ca.fmax(ca.mmax(ca.vec(a)), ca.mmax(ca.vec(b)))
    return ca.Function("any", [a, b, number], [ca.fmin(marked + number, 1)])
