"""Whether the recording of a problem can show what its estimators are asked for."""

import functools

import numpy as np
import xarray as xr

from backsight.analysis.observability import (
    Observability,
    check_observability,
    check_observability_along,
    dummies_that_would_do,
)
from backsight.discrete.steps import complaint, in_words
from backsight.errors import ModelError, TuningError
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.problem.problem import Problem
from backsight.rounding import significant
from backsight.run.diagnosis import (
    clipped_readings,
    coarse_readings,
    poles,
    rounded_readings,
    saturated_readings,
    turned_readings,
)
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


def remedies(problem: Problem, data: xr.Dataset) -> list[str]:
    """Say which dummy measurements would do for a linear model whose drift cannot be seen."""
    names = dummies_that_would_do(problem.model)
    if not names:
        return []
    factor = _samples_on_one_side(problem.model, float(data.attrs["dt"]))
    virtual = problem.model.virtual
    taken = {s.name for s in (*problem.model.signals, *(virtual.signals if virtual else ()))}
    lines = [
        f'dummy.{_unused(name, taken)} = {{ expression = "{name}", sigma = {factor} }}'
        for name in names
    ]
    one = len(names) == 1
    told = [
        f"without a further sensor, {'a dummy measurement' if one else 'dummy measurements'} of "
        f"{', '.join(names)} would do, if {'it stays' if one else 'they stay'} near zero; s is the "
        f"size (RMS) that you expect: {'; '.join(lines)}"
    ]
    if problem.recording.high_pass is None:
        slowest = _slowest(problem.model, float(data.attrs["dt"]))
        cutoff = significant(slowest / (2 * np.pi * BELOW), 2) if slowest else "..."
        told.append(
            f"what drifts more slowly than that goes out of all signals alike by high_pass = "
            f"{cutoff} in [recording] (Hz), of the estimates, too: beside "
            f"{'the dummy measurement' if one else 'dummy measurements'}, not in their place"
        )
    return told


BELOW = 5.0
"""How far below the slowest oscillation the corner of a high-pass is proposed."""


def _slowest(model: Model, dt: float) -> float:
    """Smallest natural frequency of what oscillates [rad/s], 0 if nothing does."""
    A = state_space(model)[0]
    values = np.linalg.eigvals(A) if model.continuous else np.log(np.linalg.eigvals(A) + 0j) / dt
    slow = np.abs(values[np.abs(values.imag) > 1e-6 * np.abs(values).max(initial=0.0)])
    return float(slow.min(initial=np.inf)) if slow.size else 0.0


def _samples_on_one_side(model: Model, dt: float) -> str:
    """Deviation per sample of a dummy measurement, for its slowest oscillation; in words."""
    slowest = _slowest(model, dt)
    if not slowest:
        return "s * sqrt(2 * T / dt) (T: the time that it stays on one side)"
    return f"{significant(max(1.0, float(np.sqrt(2 / (slowest * dt)))), 2)} * s"


def _unused(name: str, taken: set[str]) -> str:
    return name if name not in taken else f"{name}_stays"


def readings(problem: Problem, data: xr.Dataset) -> tuple[list[str], list[str]]:
    """Say which readings are not what they are taken for, and what counts that is no reading."""
    doubtful = turned_readings(problem.model, data) + clipped_readings(problem.model, data)
    counted = saturated_readings(problem.model, data)
    supposed = [s.name for s in problem.model.outputs if s.dummy is not None]
    if supposed:
        counted.append(f"without a sensor, but measured as zero: {', '.join(supposed)} (dummy)")
    for estimator in problem.estimators.values():
        doubtful += coarse_readings(estimator, problem.model, data)
        counted += rounded_readings(estimator, problem.model, data)
    return list(dict.fromkeys(doubtful)), list(dict.fromkeys(counted))


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
