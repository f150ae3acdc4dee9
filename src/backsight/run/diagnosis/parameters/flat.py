"""Parameters behind a kink: nothing was learned of them because there is no slope to follow."""

import dataclasses

import casadi as ca
import numpy as np
import xarray as xr

from backsight.algebra.kinks import kinked
from backsight.analysis.consistency import mean_nis, nis_band
from backsight.errors import BacksightError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.run.diagnosis._free_forces import constants_and_forces
from backsight.types import Array

UNTOLD = 0.99
"""Share of a prior's deviation from which on nothing was learned."""

AWAY = np.sqrt(3.0)
"""Deviations by which the other side of a kink is looked for, as an unscented filter does."""

MOST = 2000
"""Samples that are looked at."""


def behind_kinks(estimator: AbstractEstimator, model: Model, result: xr.Dataset) -> list[str]:
    """Say which constants could not be learned, although moving them would change the motion.

    And whether the arrival cost of a window is one that follows one side of a kink only. Of results
    whose innovations are larger than predicted only: elsewhere there is nothing that the other side
    of the kink would have to explain.
    """
    try:
        judge = yardstick(estimator, model)
        noise, prior = judge.assumed
        places, _ = constants_and_forces(model, noise)
        std0 = np.sqrt(np.diag(prior.covariance(model)))
    except BacksightError:
        return []
    if not places or not mean_nis(result) > nis_band(result, 0.99)[1]:
        return []
    last = result.isel(time=-1)
    x, std = last["x_hat"].values, last["x_std"].values
    untold = [i for i in places if std0[i] > 0 and std[i] >= UNTOLD * std0[i]]
    if not (untold or estimator.one_sided):
        return []
    move = _function(model)
    if not kinked(move):
        return []
    every = max(1, result.sizes["time"] // MOST)
    X, U = result["x_hat"].values[::every].T, result["u"].values[::every].T
    found = [(i, _beyond(model, move, X, U, i, std0[i])) for i in untold]
    lines = [_told(model.states[i].name, x[i], there) for i, there in found if there is not None]
    if estimator.one_sided and not lines:
        lines = [
            "the model has a kink, and its arrival cost is an extended Kalman filter, which has "
            "the slope of one side: bands of what is behind it may be too narrow; take "
            "SmoothedArrival or UKFArrival"
        ]
    return lines


@dataclasses.dataclass(frozen=True)
class _Beyond:
    """Value of a constant at which the motion is another one, and whether it has a slope there."""

    value: float
    slope: bool


def _told(name: str, here: float, there: _Beyond) -> str:
    where = (
        f"{name} was not learned, and the innovations are too large: where it is "
        f"({significant(here, 3)}) the model does not depend on it, at "
        f"{significant(there.value, 3)} it does, "
    )
    if there.slope:
        return where + (
            "so that there is no slope to follow; begin there, or take UKF or MHE, which look at "
            "the other side of a kink"
        )
    return where + (
        "by a jump, which has no slope on either side: only sigma points see across it; take UKF, "
        "or let the model change over a small range instead of at once"
    )


def _function(model: Model) -> ca.Function:
    """``(x, u) -> (rates or next state, outputs)``."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    both = ca.vertcat(ca.SX(model.rhs(x, u)), ca.SX(model.output(x, u)))
    return ca.Function("both", [x, u], [ca.densify(both)])


def _beyond(
    model: Model, move: ca.Function, X: Array, U: Array, i: int, std: float
) -> _Beyond | None:
    """Where the motion is another one; None if it is one all the way."""
    state, many = model.states[i], move.map(X.shape[1])
    here = np.asarray(many(X, U))
    row = ca.jacobian(move(*move.sx_in()), move.sx_in(0))[:, i]
    slope = ca.Function("slope", move.sx_in(), [ca.densify(row)]).map(X.shape[1])
    own = [k for k in range(here.shape[0]) if k != i or model.continuous]
    if np.asarray(slope(X, U))[own].any():
        return None
    for away in (-AWAY, AWAY):
        there = X.copy()
        there[i] = np.clip(X[i] + away * std, state.lower, state.upper)
        if not np.array_equal(np.asarray(many(there, U))[own], here[own]):
            return _Beyond(float(there[i, -1]), bool(np.asarray(slope(there, U))[own].any()))
    return None
