"""The samples of a window, linearised along a trajectory, as the trajectory solver wants."""

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import add_product
from backsight.engine.loops import scan
from backsight.estimators.parts.covariance import Covariance
from backsight.estimators.parts.leaf import Results, leaf
from backsight.estimators.parts.limits import Limits
from backsight.estimators.parts.stages import entries, outputs_and_limits
from backsight.estimators.parts.substeps import (
    flow,
    linear_step,
    moved_state,
    substep_inputs,
)
from backsight.estimators.scaled import Setting
from backsight.models.canonical.affine import moving_states
from backsight.solvers.trajectory import Chain


def linearise(s: Setting, integrator: Integrator, limits: Limits, chain: Chain) -> ca.Function:
    """``(X, U, Y, M, present) -> (F, c, before, H, e, A, low, high)``, see `Chain.sizes`.

    The i-th column of F and c belongs to the transition that leads to sample i.
    """
    nx, nu, ny, N = s.model.nx, s.model.nu, s.model.ny, chain.N
    sizes = {"X": nx, "U": nu, "Y": ny, "M": ny, "present": 1}
    symbols = [ca.MX.sym(k, size, N + 1) for k, size in sizes.items()]
    X, U, present = symbols[0], symbols[1], symbols[4]
    _, (F, c) = scan(
        _transition(s, integrator, chain),
        N,
        carry=[ca.MX(0)],
        xs=[X[:, :-1], X[:, 1:], U[:, :-1], U[:, 1:], present[:, :-1]],
    )
    before, *seen = outputs_and_limits(s, limits, chain).call(symbols)
    first = ca.DM(ca.project(ca.DM.eye(nx), chain.F).nonzeros())
    return ca.Function(
        "linearise",
        symbols,
        [ca.horzcat(first, F), ca.horzcat(ca.DM.zeros(nx), c), before, *seen],
        list(sizes),
        ["F", "c", "before", "H", "e", "A", "low", "high"],
    )


def _substep(s: Setting, integrator: Integrator) -> tuple[ca.SX, list[ca.SX]]:
    """State one sub-step later, and the symbols x, ua, ub."""
    symbols = [
        ca.SX.sym(n, k) for n, k in (("x", s.model.nx), ("ua", s.model.nu), ("ub", s.model.nu))
    ]
    x, ua, ub = symbols
    if not s.model.continuous:
        return s.model.rhs(x, ua), symbols
    h = s.dt / integrator.steps
    return flow(s, integrator, x, ua=ua, ub=ub, h=h), symbols


def transition_pattern(s: Setting, integrator: Integrator) -> ca.Sparsity:
    """Where the transition matrix of a whole sample can differ from zero, and its diagonal."""
    nx, steps = s.model.nx, _steps(s, integrator)
    found = linear_step(s, integrator) if Covariance(nx).whole else None
    if found is not None:
        total = np.linalg.matrix_power(found[0], steps) != 0
    else:
        moved, (x, _, _) = _substep(s, integrator)
        once = np.asarray(ca.DM(ca.jacobian(moved, x).sparsity(), 1.0).full()) != 0
        total = np.eye(nx, dtype=bool)
        for _ in range(steps):
            total = (once.astype(int) @ total.astype(int)) > 0
    return ca.sparsify(ca.DM((total | np.eye(nx, dtype=bool)).astype(float))).sparsity()


def _steps(s: Setting, integrator: Integrator) -> int:
    return integrator.steps if s.model.continuous else 1


def _transition(s: Setting, integrator: Integrator, chain: Chain) -> ca.Function:
    """Transition matrix and defect from one sample to the next, identity where nothing moves."""
    nx, nu = s.model.nx, s.model.nu
    count, x, x_next = ca.MX.sym("k"), ca.MX.sym("x", nx), ca.MX.sym("x_next", nx)
    u, u_next, here = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu), ca.MX.sym("here")
    inputs = [count, x, x_next, u, u_next, here]
    xs, held = substep_inputs(integrator, u, u_next)
    if not s.model.continuous:
        xs, held = [], [u, u]
    if chain.dense:
        end, F = _moved_of_many(s, integrator, chain, x, xs, held)
        still = ca.MX(ca.DM(ca.project(ca.DM.eye(nx), chain.F).nonzeros()))
        results = [count + 1, ca.if_else(here, F, still), ca.if_else(here, end - x_next, 0)]
        return ca.Function("transition_of_many", inputs, results)
    moving = moving_states(s.model)
    start = ca.MX(np.eye(nx)[moving, :])
    leaf = _variation(s, integrator, moving)
    carry = [x, start]
    (end, rows), _ = scan(leaf, _steps(s, integrator), carry=carry, xs=xs, constants=held)
    gathered = _gather(chain, moving)(count, end, rows, x_next, here)
    return ca.Function("transition", inputs, list(gathered))


def _moved_of_many(
    s: Setting,
    integrator: Integrator,
    chain: Chain,
    x: ca.MX,
    xs: list[ca.MX],
    held: list[ca.MX],
) -> tuple[ca.MX, ca.MX]:
    """State one sample later, and the entries of the transition matrix; of linear models constants.

    Derivatives go along transposed.
    """
    nx, steps, moved = s.model.nx, _steps(s, integrator), moved_state(s, integrator)
    found = linear_step(s, integrator)
    symbols = [ca.MX.sym(moved.name_in(k), *moved.size_in(k)) for k in range(3)]
    x_next, Phi = moved(*symbols)
    if found is not None:
        body = ca.Function("moved_once", symbols, [x_next])
        (end,), _ = scan(body, steps, carry=[x], xs=xs, constants=held)
        power = ca.DM(np.linalg.matrix_power(found[0], steps))
        return end, ca.MX(ca.DM(ca.project(power, chain.F).nonzeros()))
    if steps == 1:
        inputs = [k[:, 0] for k in xs] or held
        end, once = moved(x, *inputs)
        return end, ca.project(once, chain.F).nz[:]
    rows = ca.MX.sym("S", nx, nx)
    product = add_product(ca.MX.zeros(nx, nx), rows, Phi)
    varied = ca.Function("variation_of_many", [symbols[0], rows, *symbols[1:]], [x_next, product])
    start = ca.MX(np.eye(nx))
    (end, turned), _ = scan(varied, steps, carry=[x, start], xs=xs, constants=held)
    places = [c + nx * r for r, c in zip(chain.F.row(), chain.F.get_col(), strict=True)]
    return end, ca.vec(turned)[places]


def _variation(s: Setting, integrator: Integrator, moving: list[int]) -> ca.Function:
    """One sub-step of the state and of the moving rows of its sensitivities."""
    moved, (x, ua, ub) = _substep(s, integrator)
    rows = ca.SX.sym("S", len(moving), s.model.nx)
    full = ca.SX.eye(s.model.nx)
    full[moving, :] = rows
    Phi = ca.jacobian(moved, x)[moving, :]
    return ca.Function("variation", [x, rows, ua, ub], [moved, ca.densify(Phi @ full)])


def _gather(chain: Chain, moving: list[int]) -> ca.Function:
    nx = chain.nx

    def formula(count: ca.SX, end: ca.SX, rows: ca.SX, x_next: ca.SX, here: ca.SX) -> Results:
        F = ca.SX.eye(nx)
        F[moving, :] = rows
        F = ca.if_else(here, ca.densify(F), ca.densify(ca.SX.eye(nx)))
        return {
            "count": count + 1,
            "F": entries(F, chain.F),
            "c": ca.if_else(here, end - x_next, 0),
        }

    sizes = {"count": 1, "end": nx, "x": nx, "rows": (len(moving), nx), "here": 1}
    return leaf("gather", sizes, formula)
