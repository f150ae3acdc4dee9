"""Parameters whose prior or estimate makes no sense: poles, surprises, bands too narrow."""

import dataclasses

import casadi as ca
import numpy as np
import xarray as xr

from backsight.errors import BacksightError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Prior
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.run.diagnosis._free_forces import constants_and_forces
from backsight.run.diagnosis._judges import Judges
from backsight.run.diagnosis.parameters.identifiability import check_identifiability
from backsight.types import Array

REACH = 2.0
"""Standard deviations within which a prior reaches a value."""

FAR = 5.0
"""Standard deviations of its prior from which on an estimate is a surprise."""

SHRUNK = 0.5
"""A band this much narrower than what the recording tells at the estimate is not believed."""


def poles(estimator: AbstractEstimator, model: Model) -> list[str]:
    """Say which states' priors reach zero where the model divides by them, a sentence each."""
    try:
        _, prior = estimator.assumed
        x0, std = prior.mean(model), np.sqrt(np.diag(prior.covariance(model)))
    except BacksightError:
        return []
    return [
        f"{model.states[i].name}: its prior, {significant(x0[i], 3)} ± {significant(std[i], 2)}, "
        "reaches zero, where the model is not finite (it divides by it): an estimate may end on "
        "the wrong side; let it be positive (positive = true), or narrow the prior"
        for i in dividing(model, x0, std)
        if abs(x0[i]) <= REACH * std[i] and not model.states[i].positive
    ]


def dividing(model: Model, x0: Array, std: Array) -> list[int]:
    """States at whose zero the model is not finite, although it is beside it."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    rows = ca.densify(ca.vertcat(ca.SX(model.rhs(x, u)), ca.SX(model.output(x, u))))
    look = ca.Function("look", [x, u], [rows])
    # Away from zero in all else, so that a quotient of two zeros is none.
    beside = x0 + 0.37 * np.where(std > 0, std, np.where(x0 == 0, 1.0, 0.0))
    inputs = np.array([0.41 * (s.scale or 1.0) for s in model.inputs])
    if not np.isfinite(np.asarray(look(beside, inputs))).all():
        return []
    found = []
    for i in range(model.nx):
        there = beside.copy()
        there[i] = 0.0
        if not np.isfinite(np.asarray(look(there, inputs))).all():
            found.append(i)
    return found


def surprises(estimator: AbstractEstimator, judges: Judges, result: xr.Dataset) -> list[str]:
    """Say which constants of a result are not to be believed, a sentence each."""
    model = judges.model
    try:
        judge = yardstick(estimator, model)
        noise, prior = judge.assumed
        places, _ = constants_and_forces(model, noise)
        x0, P0 = prior.mean(model), prior.covariance(model)
    except BacksightError:
        return []
    std0 = np.sqrt(np.diag(P0))
    last = result.isel(time=-1)
    x, std = last["x_hat"].values, last["x_std"].values
    asked = [i for i in places if std0[i] > 0]
    if not asked or not (np.isfinite(x).all() and np.isfinite(std).all()):
        return []
    poles_at = dividing(model, x0, std0)
    found = []
    for i in asked:
        name = model.states[i].name
        if i in poles_at and x[i] * x0[i] < 0:
            found.append(
                f"{name} ended at {significant(x[i], 3)}, on the other side of zero, where the "
                "model is not finite: it has no meaning there; let it be positive (positive = true)"
            )
        elif (far := _distance(model, i, x[i], x0[i], std0[i])) > FAR:
            found.append(
                f"{name} ended {significant(far, 2)} standard deviations of its prior from where "
                "it began: the prior, or the model, is wrong"
            )
    return found + _too_narrow(judge, judges, x, std, asked)


def _distance(model: Model, i: int, x: float, x0: float, std: float) -> float:
    if model.states[i].positive and x > 0:
        return float(abs(np.log(x / x0)) / np.sqrt(np.log1p((std / x0) ** 2)))
    return abs(x - x0) / std


def _too_narrow(
    judge: AbstractEstimator, judges: Judges, x: Array, std: Array, asked: list[int]
) -> list[str]:
    """Bands far below what the recording tells at the estimate, and what is then flat.

    A filter whose estimates move linearises at one value after the other, and takes for information
    what none of them tells: most of all along a trade-off, whose direction turns. Begun at the
    estimate, with the same prior, and measuring what it simulates, it stays there: what it then
    gathers is the Fisher information.
    """
    model, (_, prior) = judges.model, judge.assumed
    before = prior.mean(model)
    start, ratio = before.copy(), np.ones(model.nx)
    start[asked] = x[asked]
    for i in asked:
        if model.states[i].positive and before[i] > 0 and x[i] > 0:
            ratio[i] = x[i] / before[i]  # the prior of a logarithm is relative
    P0 = prior.covariance(model) * np.outer(ratio, ratio)
    again = dataclasses.replace(judge, prior=Prior(x0=start, P0=P0))  # type: ignore[call-arg]
    try:
        expected = check_identifiability(again, model, judges.recording)
    except BacksightError:
        return []
    told = {band.name: band.std for band in expected.parameters}
    names = {model.states[i].name: i for i in asked}
    narrow = [n for n, i in names.items() if n in told and std[i] < SHRUNK * told[n]]
    found = [
        f"{n} is said to be known ± {significant(std[names[n]], 2)}, but the recording tells "
        f"± {significant(told[n], 2)} at this value: begin nearer to it, or iterate (MHE, MHO)"
        for n in narrow
    ]
    return [*found, *expected.flat] if found else []
