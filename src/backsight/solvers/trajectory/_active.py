"""The limits that are active along a trajectory.

First all limits on the wrong side change sides at once, in the whole window (block principal
pivoting, Júdice and Pires 1994, doi:10.1016/0305-0548(94)90106-6): two or three passes forward and
backward nearly always do. Where that does not end, or limits depend on each other, the dual active
set method takes over, which always ends (`backsight.solvers.trajectory._dual`).
"""

import casadi as ca

from backsight.engine.loops import iterate
from backsight.solvers.trajectory._adjoint import adjoint
from backsight.solvers.trajectory._dual import dual
from backsight.solvers.trajectory.chain import Chain
from backsight.solvers.trajectory.smoother import filtered

BLOCK_PASSES = 8
"""Passes in which all wrong limits change sides at once."""


def solve(chain: Chain) -> ca.Function:
    """Build the solver of the linear problem with its limits.

    ``(delta, P, *stages, side) -> (x, eta, nu, side, P_end, conflict, residual, passes, open)``.
    Given is a guess of the active limits. Results are the trajectory, the adjoints of the noise,
    the multipliers of the limits, the active limits, the covariance of the last sample; 1 for
    limits that contradict each other; `adjoint`'s residual; the number of passes; and 1 if they
    did not suffice.
    """
    n, m = chain.n, chain.N + 1
    given = chain.window()
    side0 = ca.MX.sym("side", n, m)
    results = _sweep(chain)(*given, side0)
    if not n:
        *rest, _ = results
        return ca.Function("solve", [*given, side0], [*rest, ca.MX(1), ca.MX(0)])

    go, count, side = ca.MX.sym("go"), ca.MX.sym("count"), ca.MX.sym("side", n, m)
    old = [ca.MX.sym(f"r{k}", *r.shape) for k, r in enumerate(results)]
    *rest, wrong = _sweep(chain)(*given, side)
    body = ca.Function(
        "pivot", [go, count, side, *old, *given], [wrong > 0, count + 1, rest[3], *rest, wrong]
    )
    start = [ca.MX(1), ca.MX(0), side0, *(ca.MX.zeros(*r.shape) for r in results)]
    _, passes, _, *found = iterate(body, BLOCK_PASSES, carry=start, constants=given)
    failed = ca.fmin(found[-1] + ca.mmax(found[5]), 1)
    once = ca.Function(
        "dual_instead",
        [go, count, *old, *given, side0],
        _instead(chain, given, side0, count),
    )
    carry = [failed, passes, *found]
    last = iterate(once, 1, carry=carry, constants=[*given, side0])
    return ca.Function("solve", [*given, side0], [*last[2:-1], last[1], last[-1]])


def _sweep(chain: Chain) -> ca.Function:
    """``(delta, P, *stages, side) -> (x, eta, nu, side, P_end, conflict, residual, wrong)``."""
    n, m = chain.n, chain.N + 1
    given = chain.window()
    side, force = ca.MX.sym("side", n, m), ca.MX.zeros(n, m)
    records = filtered(chain)(*given, side, force)
    wrong, residual, x, eta, nu, side_next, _ = adjoint(chain)(
        ca.MX(1), *records, *given[2:], side, force
    )
    end = records[1][:, -1]
    return ca.Function(
        "sweep", [*given, side], [x, eta, nu, side_next, end, records[8], residual, wrong]
    )


def _instead(chain: Chain, given: list[ca.MX], side0: ca.MX, count: ca.MX) -> list[ca.MX]:
    """The solution by the dual method, as the next carry."""
    side, conflict, passes, unfinished = dual(chain)(*given, side0)
    x, eta, nu, _, end, _, residual, _ = _sweep(chain)(*given, side)
    results = [x, eta, nu, side, end, conflict, residual, unfinished]
    return [ca.MX(0), count + passes, *results]
