"""Derivatives of the outputs of a motion by its first state."""

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import over_sample
from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array


def sensitivities(
    model: Model,
    u: Array,
    *,
    dt: float,
    x0: Array,
    integrator: Integrator,
    pushes: Array | None = None,
) -> tuple[Array, Array]:
    """Rows (n, ny, nx) of all samples, and the sizes of the states (nx,).

    Rows are divided by the sizes of the outputs and multiplied by those of the states: their
    `Signal.scale`, else the largest value of the motion. A state that is zero throughout, such as
    an unknown force, has the size that moves the outputs by their own. `pushes` (n, nx) are added
    to the state after every sample: what walks do to it.

    Raises
    ------
    ModelError
        If the motion does not stay finite.
    """
    step = _step(model, dt, integrator)
    x, Phi = np.asarray(x0, float), np.eye(model.nx)
    inputs = np.asarray(u, float).reshape(len(u), model.nu)
    states, outputs, rows = [], [], []
    for k in range(len(inputs)):
        ahead = inputs[min(k + 1, len(inputs) - 1)]
        moved, y, F, H = (np.array(v) for v in step.call([x, inputs[k], ahead]))
        states.append(x)
        outputs.append(y[:, 0])
        rows.append(H @ Phi)
        with np.errstate(over="ignore", invalid="ignore"):
            x, Phi = moved[:, 0] + (0.0 if pushes is None else pushes[k]), F @ Phi
        if not (np.isfinite(x).all() and np.isfinite(Phi).all()):
            raise ModelError(
                f"the motion of model '{model.name}' is not finite from sample {k + 1} on; give "
                "another start, fewer samples or more sub-steps"
            )
    unit = _sizes(model.outputs, np.array(outputs))
    unit[unit == 0] = 1.0
    relative = np.array(rows) / unit[:, None]
    size = _sizes(model.states, np.array(states))
    effect = np.sqrt((relative**2).sum(axis=(0, 1)))
    size = np.where(size > 0, size, 1 / np.where(effect > 0, effect, 1.0))
    return relative * size, size


def _sizes(signals: tuple[Signal, ...], values: Array) -> Array:
    largest = np.abs(values).max(axis=0)
    return np.array([s.scale or v for s, v in zip(signals, largest, strict=True)])


def _step(model: Model, dt: float, integrator: Integrator) -> ca.Function:
    """``(x, u, u_next) -> (x_next, y, F, H)``."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    y = model.output(x, u)
    outputs = ca.Function("outputs", [x, u], [y, ca.jacobian(y, x)])
    x, u, v = (ca.MX.sym(n, k) for n, k in (("x", model.nx), ("u", model.nu), ("v", model.nu)))
    end, F, _ = over_sample(integrator, model, dt)(x, u, v)
    y, H = outputs(x, u)
    return ca.Function("step", [x, u, v], [end, y, F, H])
