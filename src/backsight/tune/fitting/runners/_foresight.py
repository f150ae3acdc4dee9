"""What the model by itself makes of an estimate some samples later."""

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import advanced, explicit
from backsight.engine.loops import scan
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators import Compilable
from backsight.estimators.parts.substeps import substep_inputs
from backsight.models.model import Model


def foresight(method: Compilable, model: Model, dt: float, ahead: int) -> ca.Function:
    """Outputs `ahead` samples after an estimate, without any measurement in between.

    ``(x, U, y, mask) -> r`` with the inputs (nu, ahead + 1) from the sample of the estimate on, and
    the measurement minus the prediction, 0 where nothing was measured.
    """
    x, U = ca.MX.sym("x", model.nx), ca.MX.sym("U", model.nu, ahead + 1)
    y, mask = ca.MX.sym("y", model.ny), ca.MX.sym("mask", model.ny)
    (end,), _ = scan(_sample(method, model, dt), ahead, carry=[x], xs=[U[:, :-1], U[:, 1:]])
    r = _missed(model)(end, U[:, ahead], y, mask)
    return ca.Function("foresight", [x, U, y, mask], [r])


def _sample(method: Compilable, model: Model, dt: float) -> ca.Function:
    """The model from one sample to the next: ``(x, u, u_next) -> x``."""
    symbols = x, ua, ub = [
        ca.SX.sym(k, n) for k, n in (("x", model.nx), ("ua", model.nu), ("ub", model.nu))
    ]
    if not model.continuous:
        return ca.Function("mapped_on", symbols, [model.rhs(x, ua)])
    chosen = method.chosen(model, dt)
    if chosen is None:
        given = Integrator(hold=method.input_hold)
        chosen = explicit(given, lambda: method.modes(model), dt=dt)
    n = chosen.steps
    moved = advanced(chosen, model, x, ua=ua, ub=ub, h=dt / n)
    step = ca.Function("carried_on", symbols, [moved])
    at, u = ca.MX.sym("x", model.nx), ca.MX.sym("u", model.nu)
    u_next = ca.MX.sym("u_next", model.nu)
    xs, held = substep_inputs(chosen, u, u_next)
    (end,), _ = scan(step, n, carry=[at], xs=xs, constants=held)
    return ca.Function("sample_on", [at, u, u_next], [end])


def _missed(model: Model) -> ca.Function:
    """Measurement minus output, by the shorter way of angles: ``(x, u, y, mask) -> r``."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    y, mask = ca.SX.sym("y", model.ny), ca.SX.sym("mask", model.ny)
    e = y - model.output(x, u)
    for i, s in enumerate(model.outputs):
        if s.wrap is not None:
            e[i] -= s.wrap * ca.floor(e[i] / s.wrap + 0.5)
    return ca.Function("missed_by", [x, u, y, mask], [ca.densify(ca.if_else(mask > 0, e, 0))])


def with_foresight(model: Model, look: ca.Function, dt: float) -> Recursion:
    """A recursion over estimates: ``(carry, x, u, y, mask) -> (carry, r)``."""
    nx, nu, ny, ahead = model.nx, model.nu, model.ny, look.size2_in(1) - 1
    carry = ca.MX.sym("carry", (nx + nu) * ahead)
    data = [ca.MX.sym(k, n) for k, n in (("x", nx), ("u", nu), ("y", ny), ("mask", ny))]
    x, u, y, mask = data
    X, U = last_estimates(carry, nx, nu, ahead)
    r = look(X[:, 0], ca.horzcat(U, u), y, mask)
    after = ca.vertcat(ca.vec(ca.horzcat(X[:, 1:], x)), ca.vec(ca.horzcat(U[:, 1:], u)))
    return Recursion(
        step=ca.Function("foreseen", [carry, *data], [after, r]),
        carry0=np.zeros(carry.numel()),
        channels=(Channel("r", ("output",)),),
        dt=dt,
    )


def last_estimates(memory: ca.MX, nx: int, nu: int, ahead: int) -> tuple[ca.MX, ca.MX]:
    """Estimates and inputs of the last `ahead` samples, side by side, the oldest first."""
    X, U = ca.vertsplit(memory, [0, nx * ahead, (nx + nu) * ahead])
    return ca.reshape(X, nx, ahead), ca.reshape(U, nu, ahead)
