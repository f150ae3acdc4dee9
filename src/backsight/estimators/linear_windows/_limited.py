"""A window of a linear model with its limits, by the trajectory solver."""

import casadi as ca
import numpy as np

from backsight.engine.dense import applied, few_entries
from backsight.engine.loops import iterate, scan
from backsight.estimators.parts.leaf import Results, leaf
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.linear import Linear
from backsight.estimators.parts.stages import (
    chain_of,
    covariance_of,
    entries,
    equations_among,
    outputs_and_limits,
)
from backsight.solvers.trajectory import Chain, by_name, solve
from backsight.types import Array

WIDTH = 1e2
"""Standard deviations of the prior that stands for none, in those of what the window says."""

PASSES = 3
"""Times that this prior goes along; with the width, a balance of its bias and of rounding."""

KEPT = ("P_end", "conflict", "open")
"""What is kept of the results of `solvers.trajectory.solve`, beside trajectory and limits."""


def limited(system: Linear, limits: Limits, N: int) -> ca.Function:
    """Build the solver of a window with limits.

    ``(x_start, P_start, wide, U, Y, M, present, side)`` to ``x``, ``P``, ``side``, ``held``,
    ``conflict`` and ``open``: state and covariance (lower triangle) of the last sample, the active
    limits, whether some of them are equations, and what `solvers.trajectory.solve` says.

    The cost needs a prior. With ``wide = 1`` there is none, and `x_start, P_start` are what the
    window says of its first state without limits. They become a prior `WIDTH` times as wide, which
    then goes along with the first state (proximal point): where no limit is active it says nothing,
    and otherwise every pass leaves a share of ``WIDTH**-2`` of the error of the last one.
    """
    nx, n, m = len(system.A), len(limits.names), N + 1
    chain = chain_of(system.s, limits, _pattern(system.A), Q=system.s.Q, N=N)
    x_start, vP = ca.MX.sym("x", nx), ca.MX.sym("P", nx * (nx + 1) // 2)
    wide, side0 = ca.MX.sym("wide"), ca.MX.sym("side", n, m)
    window = _window(system, m)
    stages = _stages(system, limits, chain).call(window)
    P = chain.whole()(vP) * (1 + (WIDTH**2 - 1) * wide)
    zeros = [ca.MX.zeros(*k.shape) for k in _symbols(chain)[3:]]
    _, first, side, x, P_end, conflict, unfinished = iterate(
        _pass(chain),
        PASSES,
        carry=[ca.MX(1), x_start, side0, *zeros],
        constants=[wide, P, *stages],
    )
    kept, dropped = equations_among(chain)(side, *stages[-2:])
    problem = [first, P, *stages, kept, ca.MX.zeros(n, m)]
    # With a wide prior the covariance without limits is known already, unless equations hold.
    held = _some(chain)(kept)
    needed = dropped * ca.fmax(1 - wide, held)
    P_free = covariance_of(chain)(needed, P_end, *problem)
    names = ["x", "P", "side", "held", "conflict", "open"]
    return ca.Function(
        "limited",
        [x_start, vP, wide, *window, side0],
        [x, chain.triangle()(P_free), side, held, conflict, unfinished],
        [f"i{k}" for k in range(4 + len(window))],
        names,
    )


def _window(system: Linear, m: int) -> list[ca.MX]:
    """Symbols of U, Y, M and present."""
    ny, nu = system.D.shape
    sizes = {"U": nu, "Y": ny, "M": ny, "present": 1}
    return [ca.MX.sym(k, size, m) for k, size in sizes.items()]


def _symbols(chain: Chain) -> list[ca.MX]:
    """Whether to go on, first state, active limits, last state, and `KEPT`."""
    n, m, nx = chain.n, chain.N + 1, chain.nx
    sizes = {
        "go": (1, 1), "first": (nx, 1), "side": (n, m), "x": (nx, 1),
        "P_end": (chain.size_P, 1), "conflict": (n, m), "open": (1, 1),
    }  # fmt: skip
    return [ca.MX.sym(k, *size) for k, size in sizes.items()]


def _pass(chain: Chain) -> ca.Function:
    """Solve the window, and if its prior goes along, with the prior moved to the first state."""
    carry = _symbols(chain)
    _, first, side = carry[:3]
    wide, P, *stages = constants = [ca.MX.sym("wide"), *chain.window()[1:]]
    found = by_name(solve(chain), [first, P, *stages, side])
    go = ca.logic_and(wide, _some(chain)(found["side"]))
    # The covariance that follows is that of the prior of the last pass.
    first_next = ca.if_else(wide, found["x"][:, 0], first)
    results = [go, first_next, found["side"], found["x"][:, -1], *(found[k] for k in KEPT)]
    return ca.Function("limited_pass", [*carry, *constants], results)


def _some(chain: Chain) -> ca.Function:
    """Whether a limit is active in the window."""
    side = ca.SX.sym("side", chain.n, chain.N + 1)
    return ca.Function("some", [side], [ca.mmax(ca.vec(ca.fabs(side)))])


def _pattern(A: Array) -> ca.Sparsity:
    """Where the transition matrix, or identity before the data, is not zero."""
    return ca.sparsify(ca.DM(((A != 0) | np.eye(len(A), dtype=bool)).astype(float))).sparsity()


def _stages(system: Linear, limits: Limits, chain: Chain) -> ca.Function:
    """``(U, Y, M, present) -> (F, c, before, H, e, A, low, high)``, see `Chain.sizes`.

    Deviations are from zero, so that the trajectory is the state itself.
    """
    m = chain.N + 1
    window = _window(system, m)
    U = window[0]
    before, *seen = outputs_and_limits(system.s, limits, chain)(ca.MX.zeros(chain.nx, m), *window)
    _, (F, c) = scan(
        _transition(system, chain),
        m,
        carry=[ca.MX(0)],
        xs=[ca.horzcat(U[:, 0], U[:, :-1]), U, before],
    )
    return ca.Function("linear_stages", [*window], [F, c, before, *seen])


def _transition(system: Linear, chain: Chain) -> ca.Function:
    """Transition matrix and driven part that lead to a sample; nothing moves before the data."""
    if chain.dense:
        return _transition_of_many(system, chain)
    moved, still = (entries(ca.SX(ca.DM(k)), chain.F) for k in (system.A, np.eye(len(system.A))))
    B, B_next = (ca.sparsify(ca.DM(k)) for k in (system.B, system.B_next))

    def formula(count: ca.SX, u: ca.SX, u_next: ca.SX, before: ca.SX) -> Results:
        driven = ca.densify(ca.mtimes(B, u) + ca.mtimes(B_next, u_next))
        return {
            "count": count + 1,
            "F": ca.if_else(before, moved, still),
            "c": ca.if_else(before, driven, 0),
        }

    sizes = {"count": 1, "u": system.B.shape[1], "before": 1}
    return leaf("linear_transition", sizes, formula)


def _transition_of_many(system: Linear, chain: Chain) -> ca.Function:
    """The same of many states, as matrices."""
    nu = system.B.shape[1]
    count, u, u_next, before = (
        ca.MX.sym(k, size) for k, size in (("k", 1), ("u", nu), ("u_next", nu), ("before", 1))
    )
    moved, still = (
        ca.MX(ca.DM(ca.project(ca.DM(k), chain.F).nonzeros()))
        for k in (system.A, np.eye(len(system.A)))
    )
    driven = applied(few_entries(system.B), u) + applied(few_entries(system.B_next), u_next)
    results = [count + 1, ca.if_else(before, moved, still), before * driven]
    return ca.Function("transition_of_many", [count, u, u_next, before], results)
