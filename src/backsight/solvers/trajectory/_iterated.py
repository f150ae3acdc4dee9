r"""Nonlinear least squares over a trajectory: Gauss-Newton steps by smoothing.

The unknowns are the states :math:`x_i` of a window and adjoints :math:`\eta_i` in whose terms the
noise is :math:`w_{i-1} = Q \eta_i` and the first state :math:`\bar x + P \eta_0`, so that singular
covariances need no special case. Every iteration linearises along the guess (multiple shooting)
and solves the bounded linear problem exactly; the cost is linear in the length.

With a tolerance, steps are controlled by the merit

.. math:: \tfrac12 \eta_0' P \eta_0 + \tfrac12 \sum \eta_i' Q \eta_i + \tfrac12 \sum |e_i|^2
   + \sum_j \rho_j \sum_i |d_{ij}|

with the defects d of the trajectory and the violations of hard limits, and weights
:math:`\rho_j` above their multipliers, which are the adjoints and those of the limits; a step is
halved until the merit falls.

Source: Bell, "The iterated Kalman smoother as a Gauss-Newton method", 1994,
doi:10.1137/0804035; Särkkä and Svensson, "Levenberg-Marquardt and line-search extended Kalman
smoothers", 2020, doi:10.1109/ICASSP40776.2020.9054686.
"""

from typing import Any

import casadi as ca
import numpy as np

from backsight.engine.loops import iterate, scan
from backsight.errors import TuningError
from backsight.solvers.box import GaussNewton
from backsight.solvers.trajectory._active import solve
from backsight.solvers.trajectory._merit import merit
from backsight.solvers.trajectory.chain import Chain, by_name, naming

SHORTEST = 1e-6
"""Steps are not halved below this share of the full one."""

MARGIN = 2.0
"""Weight of the defects in the merit, in units of their largest multiplier."""

NOWHERE = 1e300
"""Cost before the first point."""

LEAST_DEVIATION = 1e-5
"""Added to the standard deviations by which steps are measured, for directions without any."""

ARMIJO = 1e-4
"""Share of the decrease to first order that a step must reach."""


def iterated(
    chain: Chain, linearise: ca.Function, method: GaussNewton, *, proximal: bool
) -> ca.Function:
    """Build the minimiser of a window.

    ``(x_bar, P, free, X, side, *data)`` to results by name: the trajectory ``X`` and the active
    limits ``side``; the last linear problem, linearised along ``along``, with the names of
    `Chain.sizes` and ``offset``; its solution with the names of `LAST`; and how it went:
    ``iterations``, and 1 for ``limit``, reached without convergence, and ``rejected``, no step that
    lowers the merit; with a tolerance the cost ``J``, the merit without its last sum.

    Parameters
    ----------
    chain : Chain
    linearise : casadi.Function
        ``(X, *data) -> stages``, the description of the samples for `smoother`.
    method : GaussNewton
        With ``tolerance = 0`` exactly `max_iterations` full steps are made.
    proximal : bool
        Where ``free = 1`` the prior is moved to the guess in every iteration.
    """
    if method.cost_tolerance is not None or method.step_tolerance is not None:
        raise TuningError("a window with process noise ends by `tolerance` only")
    build = _fixed if method.tolerance == 0 else _controlled
    return build(chain, linearise, method, proximal)


def _given(chain: Chain, linearise: ca.Function) -> list[ca.MX]:
    nx, m = chain.nx, chain.N + 1
    given = [ca.MX.sym("x_bar", nx), ca.MX.sym("P", chain.size_P), ca.MX.sym("free")]
    given += [ca.MX.sym("X", nx, m), ca.MX.sym("side", chain.n, m)]
    names = range(1, linearise.n_in())
    return given + [ca.MX.sym(linearise.name_in(i), *linearise.size_in(i)) for i in names]


def _fixed(
    chain: Chain, linearise: ca.Function, method: GaussNewton, proximal: bool
) -> ca.Function:
    """A fixed number of full steps, nothing is judged: the real-time iteration."""
    given = _given(chain, linearise)
    x_bar, P, free, X0, side0, *data = given
    step = solve(chain, most=method.active_set_passes)
    X, side = ca.MX.sym("X", *X0.shape), ca.MX.sym("side", *side0.shape)
    stages = linearise.call([X, *data])
    offset = _offset(chain, proximal)(x_bar, X[:, 0], free)
    found = by_name(step, [offset, P, *stages, side])
    problem = dict(zip(chain.sizes, stages, strict=True)) | {"offset": offset}
    results = {"X": _moved(chain)(X, found["x"]), "side": found["side"], "along": X}
    results |= problem | {k: found[k] for k in LAST}
    ignored = [ca.MX.sym(k, *v.shape) for k, v in list(results.items())[2:]]
    body = ca.Function("full_step", [X, side, *ignored, x_bar, P, free, *data], [*results.values()])
    last, _ = scan(
        body,
        method.max_iterations,
        carry=[X0, side0, *(ca.MX.zeros(*k.shape) for k in ignored)],
        constants=[x_bar, P, free, *data],
    )
    course = {"iterations": ca.MX(method.max_iterations), "limit": ca.MX(0), "rejected": ca.MX(0)}
    return naming("iterated", given, dict(zip(results, last, strict=True)) | course)


def _offset(chain: Chain, proximal: bool) -> ca.Function:
    """Prior as a deviation from the guess, zero where the prior goes with the guess."""
    kind: Any = ca.MX if chain.dense else ca.SX
    x_bar, x, free = kind.sym("x_bar", chain.nx), kind.sym("x", chain.nx), kind.sym("free")
    offset = x_bar - x
    return ca.Function(
        "offset", [x_bar, x, free], [ca.if_else(free, 0, offset) if proximal else offset]
    )


def _moved(chain: Chain) -> ca.Function:
    a, b = (ca.MX.sym(k, chain.nx, chain.N + 1) for k in "ab")
    return ca.Function("moved_window", [a, b], [a + b])


def _controlled(
    chain: Chain, linearise: ca.Function, method: GaussNewton, proximal: bool
) -> ca.Function:
    """Steps to convergence; each is halved until the merit falls."""
    given = _given(chain, linearise)
    x_bar, P, free, X0, side0, *data = given
    nx, m = chain.nx, chain.N + 1
    before = [ca.MX.sym(k, nx, m) for k in ("X", "eta", "dX", "deta")]
    numbers = [ca.MX.sym(k, size) for k, size in _numbers(chain).items()]
    t = numbers[1]
    side = ca.MX.sym("side", chain.n, m)

    X, eta = _ahead(chain)(*before, t)
    stages = linearise.call([X, *data])
    offset = _offset(chain, proximal)(x_bar, X[:, 0], free)
    # The linear problem at the point, and whether the point is better than the one before.
    inner = solve(chain, most=method.active_set_passes)
    found = by_name(inner, [offset, P, *stages, side])
    dX, eta_next = found["x"], found["eta"]
    sums = merit(chain, proximal)(offset, P, free, *stages, eta, dX, eta_next, found["nu"])
    judged = _judge(chain, method)(*numbers, chain.variances(found["P_end"]), *sums)
    accept, restart, *after = judged
    point = {"along": X, "eta": eta, "dX": dX, "deta": eta_next - eta, "side": found["side"]}
    problem = dict(zip(chain.sizes, stages, strict=True)) | {"offset": offset}
    new = point | problem | {k: found[k] for k in LAST if k != "eta"}
    later = list(new.items())[len(point) :]
    old = [*before, side, *(ca.MX.sym(k, *v.shape) for k, v in later)]
    kept = select(accept, [*new.values()], old)
    kept[0] = select(restart, [ca.repmat(x_bar, 1, m)], kept[:1])[0]
    body = ca.Function("controlled_step", [*numbers, *old, x_bar, P, free, *data], [*after, *kept])
    none = [ca.MX.zeros(*k.shape) for k in old]
    start = [ca.MX.zeros(k.numel()) for k in numbers]
    start[0], start[2] = ca.MX(1), ca.MX(NOWHERE)
    last = iterate(
        body,
        method.max_iterations,
        carry=[*start, X0, *none[1:4], side0, *none[5:]],
        constants=[x_bar, P, free, *data],
    )
    course = dict(zip(_numbers(chain), last[: len(numbers)], strict=True))
    ends = dict(zip(new, last[len(numbers) :], strict=True))
    length = _or_nan()(course["t"], course["J"])
    steps = [ends.pop(k) for k in ("eta", "dX", "deta")]
    X, eta = _ahead(chain)(ends["along"], *steps, length)
    how = {"iterations": course["count"], "limit": course["go"], "rejected": course["rejected"]}
    how["J"] = course["J"]
    return naming("iterated", given, {"X": X, "eta": eta} | ends | how)


LAST = ("eta", "nu", "P_end", "conflict", "residual", "passes", "open")
"""What is kept of the last linear problem, see `solve`."""


def _numbers(chain: Chain) -> dict[str, int]:
    """What the judge remembers: sizes by name."""
    of_defects = chain.nx + chain.n
    return {
        "go": 1, "t": 1, "J": 1, "slope": 1, "defects": of_defects, "rho": of_defects,
        "count": 1, "rejected": 1, "restarted": 1,
    }  # fmt: skip


def _ahead(chain: Chain) -> ca.Function:
    """Point after a step: ``(X, eta, dX, deta, t) -> (X, eta)``."""
    nx, m = chain.nx, chain.N + 1
    symbols = [ca.MX.sym(k, nx, m) for k in ("X", "eta", "dX", "deta")]
    t = ca.MX.sym("t")
    X, eta, dX, deta = symbols
    return ca.Function("ahead", [*symbols, t], [X + t * dX, eta + t * deta])


def _or_nan() -> ca.Function:
    """Length of the last step, not a number if no point had a finite cost."""
    t, J = ca.SX.sym("t"), ca.SX.sym("J")
    return ca.Function("or_nan", [t, J], [ca.if_else(J < NOWHERE, t, np.nan)])


def select(flag: ca.MX, then: list[ca.MX], otherwise: list[ca.MX]) -> list[ca.MX]:
    """The first list where the flag is not zero, else the second, copied as a whole."""
    carry = [flag, *otherwise]
    symbols = [ca.MX.sym(f"s{k}", *v.shape) for k, v in enumerate((*carry, *then))]
    body = ca.Function("take", symbols, [ca.MX(0), *symbols[len(carry) :]])
    return iterate(body, 1, carry=carry, constants=then)[1:]


def _judge(chain: Chain, method: GaussNewton) -> ca.Function:
    """Accept the point and go on from there, or halve the step that led to it, or start anew."""
    nx = chain.nx
    numbers = [ca.SX.sym(k, size) for k, size in _numbers(chain).items()]
    _, t, J, slope, defects, rho, count, rejected, restarted = numbers
    variances = ca.SX.sym("variances", nx)
    sizes = {
        "J_try": 1,
        "slope_try": 1,
        "defects_try": nx + chain.n,
        "adjoints": nx + chain.n,
        "steps": nx,
    }
    tried = [ca.SX.sym(k, size) for k, size in sizes.items()]
    J_try, slope_try, defects_try, adjoints, steps = tried

    before, now = J + ca.dot(rho, defects), J_try + ca.dot(rho, defects_try)
    fall = slope - ca.dot(rho, defects)
    # Rounding of a cost that counts log-likelihood must not reject a good step.
    allowed = before + ARMIJO * t * fall + 1e-9 + 1e-12 * ca.fabs(before)
    accept = now <= allowed
    finite = now < np.inf
    accept = ca.logic_and(accept, finite)
    restart = ca.logic_and(ca.logic_not(finite), ca.logic_and(count == 0, restarted == 0))
    deviation = ca.sqrt(ca.fmax(variances, 0)) + LEAST_DEVIATION
    done = ca.mmax(steps / deviation) < method.tolerance
    halved = t / 2
    stalled = ca.logic_and(ca.logic_not(ca.logic_or(accept, restart)), halved < SHORTEST)
    go = ca.logic_not(ca.logic_or(stalled, ca.logic_and(accept, done)))
    last = ca.logic_and(go, count + 1 >= method.max_iterations)
    t_next = ca.if_else(accept, 1, halved)
    after = [
        go,
        ca.if_else(ca.logic_or(stalled, last), 0, t_next),
        ca.if_else(accept, J_try, J),
        ca.if_else(accept, slope_try, slope),
        ca.if_else(accept, defects_try, defects),
        ca.if_else(accept, MARGIN * adjoints, rho),
        count + 1 - restart,
        ca.fmax(rejected, stalled),
        ca.fmax(restarted, restart),
    ]
    return ca.Function("judge", [*numbers, variances, *tried], [accept, restart, *after])
