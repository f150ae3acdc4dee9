r"""A second start where the first one is flat.

A gap that is larger than the motion, a valve that is never at its end: on one side of a kink a
model does not depend on a parameter, and Gauss-Newton has no slope to follow, however badly the
window fits. Such a window is solved again from the other side, with the parameter moved by
:math:`\pm\sqrt 3` standard deviations of its prior (the points that an unscented filter asks), and
the solution with the lowest cost is taken. Only models with kinks are, only while a constant is as
unknown after the window as before, and only if the window is not explained.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np

from backsight.algebra.kinks import kinked
from backsight.engine.loops import iterate
from backsight.estimators.scaled import Setting
from backsight.models.canonical.affine import moving_states
from backsight.models.lti import output_equation, state_equation
from backsight.solvers.trajectory import Chain, by_name, select

AWAY = np.sqrt(3.0)
"""Standard deviations by which a constant is moved."""

UNTOLD = 1 - 1e-9
"""Share of the prior's variance that is left of a constant of which a window tells nothing."""

UNLIKELY = 4.0
"""Deviations of the chi-square distribution from which on a window is not explained."""

LOWER = 1e-6
"""By how much a cost must be lower."""


def constants_with_kinks(s: Setting) -> tuple[int, ...]:
    """Places of states that are constant; none if the model is smooth."""
    if state_equation(s.model) is not None and output_equation(s.model) is not None:
        return ()
    x, u = ca.SX.sym("x", s.model.nx), ca.SX.sym("u", s.model.nu)
    both = ca.vertcat(s.model.rhs(x, u), s.model.output(x, u))
    if not kinked(ca.Function("both", [x, u], [ca.densify(both)])):
        return ()
    moving = moving_states(s.model)
    return tuple(i for i in range(s.model.nx) if i not in moving)


def from_both_sides(
    s: Setting, chain: Chain, solver: ca.Function, given: Mapping[str, ca.MX]
) -> dict[str, ca.MX]:
    """Results of a solver by name, of several starts if the first one is flat.

    Parameters
    ----------
    s : Setting
    chain : Chain
    solver : casadi.Function
        See `backsight.solvers.trajectory.iterated`; if its steps are not controlled, it knows no
        cost and starts once.
    given : dict
        Its arguments in their order: among them the guess ``X``, its active limits ``side``, the
        covariance ``P`` of the prior and the mask ``M``.
    """
    places = constants_with_kinks(s)
    if not places or "J" not in solver.name_out():
        return by_name(solver, [*given.values()])
    sizes = {k: solver.size_out(k) for k in solver.name_out()}
    held = [ca.MX.sym(k, *v.shape) for k, v in given.items()]
    arguments = dict(zip(given, held, strict=True))
    go, count, flat = ca.MX.sym("go"), ca.MX.sym("count"), ca.MX.sym("flat", len(places))
    best = {k: ca.MX.sym(k, *size) for k, size in sizes.items()}
    rows = ca.MX.sym("rows")

    # The guess itself, then the best solution with one constant moved up or down.
    moved = _moved(chain, places)(best["X"], arguments["P"], flat, count, arguments["X"])
    side = select(count > 0, [best["side"]], [arguments["side"]])[0]
    tried = by_name(solver, [*(arguments | {"X": moved, "side": side}).values()])
    told = _told(chain, places)(
        count, flat, arguments["P"], tried["P_end"], tried["J"], best["J"], rows
    )
    go_on, count_next, flat_next, better = told
    kept = select(better, [*tried.values()], [*best.values()])
    body = ca.Function(
        "start",
        [go, count, flat, *best.values(), *held, rows],
        [go_on, count_next, flat_next, *kept],
    )
    none = [ca.MX.zeros(*size) for size in sizes.values()]
    found = iterate(
        body,
        1 + 2 * len(places),
        carry=[ca.MX(1), ca.MX(0), ca.MX.zeros(len(places)), *none],
        constants=[*given.values(), _rows(given["M"])],
    )
    return dict(zip(sizes, found[3:], strict=True))


def _rows(M: ca.MX) -> ca.MX:
    """How many outputs were measured in the window."""
    return ca.sum1(ca.vec(M > 0))


def _moved(chain: Chain, places: tuple[int, ...]) -> ca.Function:
    """``(X, P, flat, count, guess) -> X`` of the start with this number; 0 is the guess."""
    nx, m = chain.nx, chain.N + 1
    X, guess = ca.MX.sym("X", nx, m), ca.MX.sym("guess", nx, m)
    P, flat, count = ca.SX.sym("P", chain.size_P), ca.SX.sym("flat", len(places)), ca.SX.sym("n")
    spread, by = ca.diag(chain.matrix(P)), ca.SX.zeros(nx)
    for k, i in enumerate(places):
        sign = ca.if_else(count == 2 * k + 1, 1, ca.if_else(count == 2 * k + 2, -1, 0))
        by[i] = sign * flat[k] * AWAY * ca.sqrt(ca.fmax(spread[i], 0))
    step = ca.Function("step", [P, flat, count], [by])
    numbers = [
        ca.MX.sym(k, size) for k, size in (("P", chain.size_P), ("f", len(places)), ("n", 1))
    ]
    shifted = X + ca.repmat(step(*numbers), 1, m)
    start = select(numbers[2] > 0, [shifted], [guess])[0]
    return ca.Function("moved_start", [X, *numbers, guess], [start])


def _told(chain: Chain, places: tuple[int, ...]) -> ca.Function:
    """Whether to go on, with which number and constants, and whether this start was better."""
    count, flat = ca.SX.sym("count"), ca.SX.sym("flat", len(places))
    before, after = ca.SX.sym("P", chain.size_P), ca.SX.sym("P_end", chain.size_P)
    J, J_best, rows = ca.SX.sym("J"), ca.SX.sym("J_best"), ca.SX.sym("rows")
    P, P_end = (ca.diag(chain.matrix(k)) for k in (before, after))
    untold = [ca.logic_and(P[i] > 0, P_end[i] >= UNTOLD * P[i]) for i in places]
    first = count == 0
    flat_next = ca.if_else(first, ca.vertcat(*untold), flat)
    unexplained = rows + UNLIKELY * ca.sqrt(2 * rows) < 2 * J
    go_on = ca.if_else(
        first, ca.logic_and(unexplained, ca.mmax(flat_next)), count < 2 * len(places)
    )
    better = ca.logic_or(first, J_best - LOWER > J)
    return ca.Function(
        "told",
        [count, flat, before, after, J, J_best, rows],
        [go_on, count + 1, flat_next, better],
    )
