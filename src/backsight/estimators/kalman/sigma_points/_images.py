"""Sigma points through the model and its outputs; of many states of linear ones as matrices."""

import casadi as ca

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.dense import few_entries, product_of
from backsight.engine.loops import scan
from backsight.estimators.base import Setting
from backsight.estimators.kalman.sigma_points._pairs import SigmaPoints
from backsight.estimators.kalman.square_root import opened_factor
from backsight.estimators.parts.covariance import Covariance, matrix_product
from backsight.estimators.parts.factors import each_column
from backsight.estimators.parts.leaf import Results, half, leaf, notation
from backsight.estimators.parts.substeps import flow, linear_step, substep_inputs
from backsight.models.lti import output_equation
from backsight.types import Array


def images_seen(s: Setting, points: SigmaPoints) -> ca.Function:
    """Outputs (ny, 2 n + 1) at sigma points, ``(x, spread, u) -> (Y, held)``, see `placed`."""
    opened, placed, told = opened_factor(s), points.placed(s), points.told(s, s.model.ny)
    x, spread = ca.MX.sym("x", s.model.nx), ca.MX.sym("spread", opened.numel_in(0))
    u = ca.MX.sym("u", s.model.nu)
    X, pairs, held = placed(x, opened(spread))
    Y = _outputs(s, placed.size2_out(0))(X, u)
    return ca.Function("looked", [x, spread, u], [told(Y, pairs, held), held])


def images_ahead(s: Setting, points: SigmaPoints, integrator: Integrator) -> ca.Function:
    """Sigma points one sample later, ``(x, spread, u, u_next) -> X``."""
    opened, placed, told = opened_factor(s), points.placed(s), points.told(s, s.model.nx)
    x, spread = ca.MX.sym("x", s.model.nx), ca.MX.sym("L", opened.numel_in(0))
    u, u_next = ca.MX.sym("u", s.model.nu), ca.MX.sym("u_next", s.model.nu)
    xs, constants = substep_inputs(integrator, u, u_next)
    steps = integrator.steps if s.model.continuous else 1
    X, pairs, held = placed(x, opened(spread))
    step = _advanced(s, integrator, placed.size2_out(0))
    (moved,), _ = scan(step, steps, carry=[X], xs=xs, constants=constants)
    return ca.Function("images", [x, spread, u, u_next], [told(moved, pairs, held)])


def _outputs(s: Setting, count: int) -> ca.Function:
    """``(X, u) -> Y`` of so many points."""
    found = output_equation(s.model) if Covariance(s.model.nx).whole else None
    if found is not None:
        C, D, d = found
        return _linear(s, count, C, [D], d)
    output = leaf("output", notation(s), lambda x, u: {"y": s.model.output(x, u)})
    sizes = {"X": (s.model.nx, count), "Y": (s.model.ny, count)}
    return half("outputs", s, lambda X, u: {"Y": each_column(output, X, u)[0]}, sizes)


def _advanced(s: Setting, integrator: Integrator, count: int) -> ca.Function:
    """``(X, ua, ub) -> X`` over a sub-step."""
    found = linear_step(s, integrator) if Covariance(s.model.nx).whole else None
    if found is not None:
        F, first, last, constant = found
        return _linear(s, count, F, [first, last], constant)

    def advance(x: ca.SX, ua: ca.SX, ub: ca.SX) -> Results:
        if not s.model.continuous:
            return {"x_next": s.model.rhs(x, ua)}
        return {"x_next": flow(s, integrator, x, ua=ua, ub=ub, h=s.dt / integrator.steps)}

    one = leaf("advance_point", notation(s), advance)
    return half(
        "advance_points",
        s,
        lambda X, ua, ub: {"X_next": each_column(one, X, ua, ub)[0]},
        {"X": (s.model.nx, count)},
    )


def _linear(s: Setting, count: int, A: Array, B: list[Array], constant: Array) -> ca.Function:
    """``(X, *u) -> A X + B u + constant`` of every column."""
    X = ca.MX.sym("X", s.model.nx, count)
    inputs = [ca.MX.sym(f"u{k}", s.model.nu) for k in range(len(B))]
    added = ca.MX(ca.DM(constant))
    for matrix, u in zip(B, inputs, strict=True):
        added += matrix_product(few_entries(matrix), u)
    columns = product_of(added, ca.MX.ones(1, count))
    return ca.Function("linear_points", [X, *inputs], [matrix_product(few_entries(A), X) + columns])
