"""Where an equation of a model has no finite value, or no finite derivative."""

import casadi as ca
import numpy as np

from backsight.models.model import Model
from backsight.rounding import shortest
from backsight.types import Array

MOST_SHOWN = 6
"""States whose values are shown beside the equation."""

REMEDY = (
    "start beside this point (x0), or round the kink or pole off, as in sqrt(abs(x) + 1e-6) or "
    "x / sqrt(x**2 + 1e-6)"
)


def culprit(model: Model, x: Array, u: Array) -> str:
    """Say which equation is not finite at a point, or has a derivative that is not; else empty."""
    xs, us = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rows = ca.densify(ca.vertcat(ca.SX(model.rhs(xs, us)), ca.SX(model.output(xs, us))))
    look = ca.Function("look", [xs, us], [rows, ca.densify(ca.jacobian(rows, xs))])
    values, slopes = (np.asarray(k) for k in look(x, u))
    names = [f"the equation of '{s.name}'" for s in model.states]
    names += [f"the output equation of '{s.name}'" for s in model.outputs]
    for i, name in enumerate(names):
        if not np.isfinite(values[i, 0]):
            return f"{name} is not finite at {_point(model, x)}; {REMEDY}"
        bad = np.flatnonzero(~np.isfinite(slopes[i]))
        if len(bad):
            by = model.states[int(bad[0])].name
            return f"{name} has no finite derivative by '{by}' at {_point(model, x)}; {REMEDY}"
    return ""


def _point(model: Model, x: Array) -> str:
    shown = [f"{s.name} = {shortest(v)}" for s, v in zip(model.states, x, strict=True)]
    more = "" if len(shown) <= MOST_SHOWN else " ..."
    return ", ".join(shown[:MOST_SHOWN]) + more
