"""Whether the recording of a problem can show what its estimators are asked for."""

import functools

import numpy as np
import xarray as xr

from backsight.analysis.observability import (
    Observability,
    check_observability,
    check_observability_along,
)
from backsight.discrete.steps import complaint, in_words
from backsight.errors import ModelError, TuningError
from backsight.problem.problem import Problem
from backsight.run.diagnosis import poles
from backsight.run.estimation import matched_inputs

FIRST_SAMPLES, MOST_SAMPLES = 500, 8000
"""A motion that shows not everything is followed for longer, up to the second number."""


def examine(problem: Problem, data: xr.Dataset) -> Observability:
    """Judge the model: by itself if it is linear, else along its motion under the recorded inputs.

    The motion starts from the prior of the first estimator.

    Raises
    ------
    ModelError
        If the motion does not stay finite.
    """
    try:
        return check_observability(problem.model)
    except ModelError:
        u = matched_inputs(problem.model, data)
    first = next(iter(problem.estimators.values()))
    try:
        x0 = first.assumed[1].mean(problem.model)
    except TuningError:
        x0 = None
    along = functools.partial(
        check_observability_along,
        problem.model,
        dt=float(data.attrs["dt"]),
        x0=x0,
        integrator=first.integration,
    )
    samples = FIRST_SAMPLES
    while True:
        try:
            found = along(u[:samples], walks=_walks(problem))
        except ModelError:  # noise may drive a parameter to where the model is none
            found = along(u[:samples])
        if found.observable or samples >= min(len(u), MOST_SAMPLES):
            return found
        samples *= 4


def _walks(problem: Problem) -> dict[str, float]:
    """What moves every state from sample to sample, in the opinion of the first estimator."""
    model = problem.model
    noise = next(iter(problem.estimators.values())).assumed[0]
    if noise.Q is not None or noise.Qc is not None or noise.sigma_w is None:
        return {}
    sigma = np.sqrt(np.diag(noise.process(model)))
    return {s.name: float(v) for s, v in zip(model.states, sigma, strict=True) if v > 0}


def doubts(problem: Problem, data: xr.Dataset) -> list[str]:
    """What to tell before a run; nothing if everything can be seen or the motion cannot be made."""
    coarse = [*priors_at_poles(problem), *coarse_steps(problem, data)]
    try:
        found = examine(problem, data)
    except ModelError:
        return coarse
    return coarse if found.detectable else [*coarse, *found.lines()]


def priors_at_poles(problem: Problem) -> list[str]:
    """Parameters whose prior reaches zero where the model divides by them, a line each."""
    told = [line for e in problem.estimators.values() for line in poles(e, problem.model)]
    return list(dict.fromkeys(told))


def integration(problem: Problem, data: xr.Dataset) -> list[str]:
    """How the estimators carry the model from sample to sample, a line each."""
    dt, model = float(data.attrs["dt"]), problem.model
    chosen = {name: e.chosen(model, dt) for name, e in problem.estimators.items()}
    return [f"{name}: {in_words(c)}" for name, c in chosen.items() if c is not None]


def coarse_steps(problem: Problem, data: xr.Dataset) -> list[str]:
    """Integration steps that are too coarse somewhere in the range of the prior, a line each."""
    dt, model, lines = float(data.attrs["dt"]), problem.model, []
    for name, estimator in problem.estimators.items():
        chosen = estimator.chosen(model, dt)
        if chosen is not None:
            modes = functools.partial(estimator.modes, model)
            lines.append((name, complaint(chosen, modes, dt=dt)))
    return [f"{name}: {sentence}" for name, sentence in lines if sentence]
