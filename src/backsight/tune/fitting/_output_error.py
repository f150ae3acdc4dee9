"""Parameters that predict the next sample but not a whole recording, and an output-error fit."""

import dataclasses
from typing import Any

import numpy as np

from backsight.errors import BacksightError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.rounding import significant
from backsight.tune.fitting._descent import EXCERPT, ROUGHLY, Optimum, Search, descend
from backsight.tune.fitting._objective import Objective
from backsight.tune.fitting.values import Free, Unknown, unknowns_of

PASSES = 40.0
"""Passes over the excerpt of either of the two fits."""

WORSE = 1.3
"""How many times as far off a simulation may be as the best one before it is told."""

FIXED = 1e-4
"""Spread of a value that stays where it is."""


def simulating(estimator: AbstractEstimator, model: Model) -> AbstractEstimator:
    """The estimator without anything to correct by: no process noise, a start that is certain.

    Its innovations are the errors of a simulation, its likelihood that of an output-error fit.
    """
    noise, prior = estimator.assumed
    changes: dict[str, Any] = {
        "noise": dataclasses.replace(noise, sigma_w=None, Q=None, Qc=None),
        "prior": dataclasses.replace(prior, sigma_x0=None, P0=np.zeros((model.nx, model.nx))),
    }
    return dataclasses.replace(estimator, **changes)


def unknowns_of_simulation(
    estimator: AbstractEstimator,
    model: Model,
    unknowns: tuple[Unknown, ...],
    *,
    recordings: int,
) -> tuple[Unknown, ...]:
    """Parameters of a fit as they are, start values, and how far the sensors are off."""
    sigma = np.sqrt(np.diag(estimator.assumed[1].covariance(model)))
    per = "all" if recordings == 1 else "recording"
    starts = [
        Free(f"x0.{s.name}", sigma=float(size), per=per)
        for s, size in zip(model.states, sigma, strict=True)
        if size > 0
    ]
    word = "sigma_y" if estimator.assumed[0].R is None else "R"
    parameters = [
        Free(u.name, sigma=u.spread * abs(u.scale.slope(0.0)), per=u.per)
        for u in unknowns
        if u.kind == "parameter"
    ]
    free = [*parameters, *starts, Free(word, spread=float("inf"))]
    return unknowns_of(free, simulating(estimator, model), model)


def doubts_of_simulation(objective: Objective, passes: float = PASSES) -> list[str]:
    """Say if the values at the start of an output-error objective simulate badly.

    Parameters
    ----------
    objective : Objective
        Of `unknowns_of_simulation`, started at the parameters that were found.
    passes : float
    """
    share = min(EXCERPT / objective.samples, 1.0)
    short = objective.cut(lambda n: slice(0, int(n * share)))
    fixed = [
        dataclasses.replace(c, unknown=dataclasses.replace(c.unknown, spread=FIXED))
        if c.unknown.kind == "parameter"
        else c
        for c in short.coordinates
    ]
    try:
        own = _descended(dataclasses.replace(short, coordinates=tuple(fixed)), passes)
        best = _descended(short, passes)
    except BacksightError:
        return []
    if not np.isfinite(best.evaluation.cost):
        return []
    if not np.isfinite(own.evaluation.cost):
        return ["a simulation with these parameters diverges, one with others does not"]
    found = []
    moved = _most_moved(short, best)
    for k, c in enumerate(short.coordinates):
        if c.unknown.kind not in ("sigma_y", "R"):
            continue
        a, b = (c.unknown.scale.value(float(end.place[k])) for end in (own, best))
        if c.unknown.kind == "R":
            a, b = float(np.sqrt(a)), float(np.sqrt(b))
        if a > WORSE * b:
            what = c.name.partition(".")[2] or "the outputs"
            found.append(
                f"a simulation with these parameters misses {what} {significant(a / b, 3)} times "
                f"as much as that of an output-error fit{moved}: they predict the next sample; to "
                "simulate with them take the criterion Simulation() or Prediction()"
            )
    return found


def _descended(objective: Objective, passes: float) -> Optimum:
    search = Search(passes, lambda _: None, objective.samples)
    return descend(objective, np.zeros(len(objective.coordinates)), search, near=ROUGHLY)


def _most_moved(objective: Objective, best: Optimum) -> str:
    """The parameter that such a fit would change most, in words."""
    size = np.sqrt(np.diag(np.linalg.inv(best.evaluation.curvature)))
    moves = {
        k: abs(best.place[k]) / size[k]
        for k, c in enumerate(objective.coordinates)
        if c.unknown.kind == "parameter"
    }
    if not moves:
        return ""
    k = max(moves, key=lambda i: moves[i])
    scale = objective.coordinates[k].unknown.scale
    value = significant(scale.value(float(best.place[k])), 4)
    return f" ({objective.coordinates[k].name} = {value} there)"
