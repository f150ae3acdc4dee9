"""Which equation was not finite when an estimate was lost."""

import casadi as ca
import numpy as np
import xarray as xr

from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.rounding import shortest
from backsight.schema import CULPRIT, Status
from backsight.types import Array

MOST_SHOWN = 6
"""States whose values are shown beside the equation."""


def with_culprit(result: xr.Dataset, estimator: AbstractEstimator, model: Model) -> xr.Dataset:
    """Result with the attribute `schema.CULPRIT` if an equation was not finite where it failed."""
    lost = np.flatnonzero(result["status"].values & int(Status.NOT_FINITE))
    if not len(lost):
        return result
    k = int(lost[0])
    x, u = result["x_hat"].values, result["u"].values
    points = [(x[i], u[j]) for i, j in ((k, k), (k - 1, k - 1), (k - 1, k)) if i >= 0]
    if k == 0:
        try:
            points.append((estimator.assumed[1].mean(model), u[0]))
        except BacksightError:
            return result
    for point, command in points:
        if np.isfinite(point).all() and (said := culprit(model, point, command)):
            return result.assign_attrs({CULPRIT: said})
    return result


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


REMEDY = (
    "start beside this point (x0), or round the kink or pole off, as in sqrt(abs(x) + 1e-6) or "
    "x / sqrt(x**2 + 1e-6)"
)


def _point(model: Model, x: Array) -> str:
    shown = [f"{s.name} = {shortest(v)}" for s, v in zip(model.states, x, strict=True)]
    more = "" if len(shown) <= MOST_SHOWN else " ..."
    return ", ".join(shown[:MOST_SHOWN]) + more
