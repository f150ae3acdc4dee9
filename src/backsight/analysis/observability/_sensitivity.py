"""Derivatives of the outputs of a motion by its first state."""

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.steps import over_sample
from backsight.engine import vm
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import ModelError
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.singular import culprit
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
    n, nx = len(u), model.nx
    inputs = np.asarray(u, float).reshape(n, model.nu)
    moves = np.zeros((n, nx)) if pushes is None else pushes
    recursion = _recursion(model, dt, integrator, x0=np.asarray(x0, float))
    end, (before, outputs, rows) = vm.run(
        recursion, [inputs, np.vstack([inputs[1:], inputs[-1:]]), moves], carry=recursion.carry0
    )
    finite = np.isfinite(np.vstack([before[1:], end])).all(axis=1)
    if not finite.all():
        k = int(finite.argmin())
        why = culprit(model, before[k, :nx], inputs[k])
        raise ModelError(
            f"the motion of model '{model.name}' is not finite from sample {k + 1} on; "
            + (why or "give another start, fewer samples or more sub-steps")
        )
    unit = _sizes(model.outputs, outputs)
    unit[unit == 0] = 1.0
    relative = rows.reshape(n, nx, model.ny).transpose(0, 2, 1) / unit[:, None]
    size = _sizes(model.states, before[:, :nx])
    effect = np.sqrt((relative**2).sum(axis=(0, 1)))
    size = np.where(size > 0, size, 1 / np.where(effect > 0, effect, 1.0))
    return relative * size, size


def _sizes(signals: tuple[Signal, ...], values: Array) -> Array:
    largest = np.abs(values).max(axis=0)
    return np.array([s.scale or v for s, v in zip(signals, largest, strict=True)])


def _recursion(model: Model, dt: float, integrator: Integrator, *, x0: Array) -> Recursion:
    """The motion and its derivatives Phi by the first state: memory, y and H Phi of each sample."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    y = model.output(x, u)
    sensors = ca.Function("outputs", [x, u], [y, ca.jacobian(y, x)])
    sizes = {"before": model.nx * (1 + model.nx), "u": model.nu, "ahead": model.nu, "w": model.nx}
    before, u, ahead, w = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
    x, Phi = before[: model.nx], ca.reshape(before[model.nx :], model.nx, model.nx)
    end, F, _ = over_sample(integrator, model, dt)(x, u, ahead)
    y, H = sensors(x, u)
    after = ca.vertcat(end + w, ca.vec(F @ Phi))
    step = ca.Function("motion", given, [after, before, y, ca.vec(H @ Phi)])
    channels = tuple(Channel(name) for name in ("before", "y", "rows"))
    return Recursion(step, np.concatenate([x0, np.eye(model.nx).ravel()]), channels, dt)
