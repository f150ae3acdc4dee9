"""The model from sample to sample in sub-steps, its derivatives, and states within their bounds.

Derivatives are those that filters of models with many states take. Where the model is linear its
matrices are constants and the products with them operations on matrices: an expression for every
entry would take minutes to compile. Otherwise the model is a leaf, of whose derivatives only the
entries that are not zero count.
"""

import casadi as ca
import numpy as np

from backsight.algebra import bounds
from backsight.discrete.exact import foh, zoh
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import advanced
from backsight.engine.dense import UNROLL, few_entries
from backsight.engine.loops import smallest
from backsight.estimators.parts.covariance import matrix_product
from backsight.estimators.parts.flags import Flags
from backsight.estimators.parts.leaf import Results, leaf, notation
from backsight.estimators.scaled import Setting
from backsight.models.lti import output_equation, state_equation
from backsight.types import Array


def flow(s: Setting, integrator: Integrator, x: ca.SX, *, ua: ca.SX, ub: ca.SX, h: float) -> ca.SX:
    """One sub-step of the state, eq. 33-34 of Polóni et al. (2012) for Heun's method."""
    return advanced(integrator, s.model, x, ua=ua, ub=ub, h=h)


def substep_inputs(
    integrator: Integrator, u: ca.MX, u_next: ca.MX
) -> tuple[list[ca.MX], list[ca.MX]]:
    """Inputs at both ends of the sub-steps: as columns (ramp), or once for all (held)."""
    if integrator.hold == "zoh":
        return [], [u, u]
    return ramp(integrator.steps, u, u_next), []


def ramp(n: int, a: ca.MX, b: ca.MX) -> list[ca.MX]:
    """Values at the beginning and at the end of n sub-steps from a to b, side by side."""
    first, last = ca.SX.sym("a", a.numel()), ca.SX.sym("b", b.numel())
    grid = [first + (k / n) * (last - first) for k in range(n + 1)]
    name = f"ramp_{n}_of_{a.numel()}"
    columns = [ca.horzcat(*grid[:-1]), ca.horzcat(*grid[1:])]
    return list(ca.Function(name, [first, last], columns)(a, b))


def within_bounds(s: Setting, x: ca.SX) -> ca.SX:
    """Set states outside their bounds to the bounds."""
    return bounds.clip(x, s.lower, s.upper)


def settled(s: Setting) -> ca.Function:
    """State within its bounds, and flags: ``(x, variances, of the innovation) -> (x, flags)``."""
    if s.model.nx > UNROLL:
        return _settled_of_many(s)

    def formula(x: ca.SX, variance: ca.SX, y: ca.SX) -> Results:
        inside = within_bounds(s, x)
        clipped = ca.if_else(ca.norm_1(inside - x) > 0, 1, 0)
        definite = ca.mmin(ca.vertcat(variance, y)) >= 0
        flags = Flags(clipped=clipped, not_positive_definite=ca.if_else(definite, 0, 1))
        return {"x_inside": inside, "flags": flags.vector()}

    return leaf("settled", {**notation(s), "variance": s.model.nx}, formula)


def within_bounds_of_many(s: Setting, x: ca.MX) -> ca.MX:
    """`within_bounds` of many states."""
    if not (np.isfinite(s.lower).any() or np.isfinite(s.upper).any()):
        return x
    return ca.fmin(ca.fmax(x, ca.DM(s.lower)), ca.DM(s.upper))


def _settled_of_many(s: Setting) -> ca.Function:
    """`settled` of many states."""
    x, variance, y = (ca.MX.sym("x", n) for n in (s.model.nx, s.model.nx, s.model.ny))
    inside = within_bounds_of_many(s, x)
    moved, least = ca.SX.sym("moved"), ca.SX.sym("least")
    clipped, definite = ca.if_else(moved > 0, 1, 0), least >= 0
    flags = Flags(clipped=clipped, not_positive_definite=ca.if_else(definite, 0, 1))
    told = ca.Function("settled", [moved, least], [flags.vector()])
    farthest = ca.MX(0) if inside is x else -smallest(-ca.fabs(inside - x))
    raised = told(farthest, smallest(ca.vertcat(variance, y)))
    return ca.Function("settled_of_many", [x, variance, y], [inside, raised])


def seen_outputs(s: Setting) -> ca.Function:
    """Expected outputs and their derivative: ``(x, u) -> (y, H)``."""
    found = output_equation(s.model)
    if found is None:

        def formula(x: ca.SX, u: ca.SX) -> Results:
            y = s.model.output(x, u)
            return {"y_expected": ca.densify(y), "H": ca.jacobian(y, x)}

        return leaf("seen_outputs", notation(s), formula)
    C, D, d = found
    x, u = ca.MX.sym("x", s.model.nx), ca.MX.sym("u", s.model.nu)
    y = _sum([(C, x), (D, u)], d)
    return ca.Function("seen_outputs", [x, u], [y, ca.MX(few_entries(C))])


def moved_state(s: Setting, integrator: Integrator) -> ca.Function:
    """State one sub-step later, or one sample of a discrete model: ``(x, ua, ub) -> (x, Phi)``."""
    found = linear_step(s, integrator)
    if found is None:

        def formula(x: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
            if s.model.continuous:
                h = s.dt / integrator.steps
                x_next = flow(s, integrator, x, ua=ua, ub=ub, h=h)
            else:
                x_next = s.model.rhs(x, ua)
            return {"x_next": x_next, "Phi": ca.jacobian(x_next, x)}

        return leaf("moved", notation(s), formula)
    F, first, last, constant = found
    x, ua, ub = (ca.MX.sym(k, n) for k, n in (("x", s.model.nx), *[("u", s.model.nu)] * 2))
    x_next = _sum([(F, x), (first, ua), (last, ub)], constant)
    return ca.Function("moved", [x, ua, ub], [x_next, ca.MX(few_entries(F))])


def linear_step(s: Setting, integrator: Integrator) -> tuple[Array, Array, Array, Array] | None:
    """Matrices F, B, B_next and constants c of a sub-step F x + B ua + B_next ub + c.

    None unless the model is linear and, if it is continuous, goes over the sub-step exactly.
    """
    if s.model.continuous and integrator.scheme != "exact":
        return None
    found = state_equation(s.model)
    if found is None:
        return None
    A, B, c = found
    none = np.zeros_like(B)
    if not s.model.continuous:
        return A, B, none, c
    h, inputs = s.dt / integrator.steps, np.hstack([B, c[:, None]])  # an input of one
    if integrator.hold == "zoh":
        F, held = zoh(A, inputs, dt=h)
        F, first, last = F, held, np.zeros_like(held)
    else:
        F, first, last = foh(A, inputs, dt=h)
    # What does not move (a parameter) stays as it is to the last bit.
    still = ~(np.abs(np.hstack([A, inputs])).sum(axis=1) > 0)
    F[still], first[still], last[still] = np.eye(len(A))[still], 0.0, 0.0
    return F, first[:, :-1], last[:, :-1], first[:, -1] + last[:, -1]


def _sum(terms: list[tuple[Array, ca.MX]], constant: Array) -> ca.MX:
    total = ca.MX(ca.DM(constant))
    for matrix, vector in terms:
        if matrix.any():
            total += matrix_product(few_entries(matrix), vector)
    return total
