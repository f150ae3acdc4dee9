"""One reader for every kind of value: from its name to where the search starts, and its prior."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from backsight.errors import TuningError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.models.forces.changing import followed_process
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune.fitting.values._free import Free
from backsight.tune.fitting.values._matrix import blocks_of
from backsight.tune.fitting.values._scale import (
    AbstractScale,
    BoundedScale,
    LinearScale,
    LogScale,
    scale_of,
)
from backsight.tune.fitting.values._settings import (
    number_at,
    range_at,
    several,
    with_number,
)
from backsight.tune.fitting.values._unknown import Kind, Unknown

LOOSE, PHYSICAL, SETTING, PROCESS = 30.0, 3.0, 10.0, 10.0
"""Factors by which noise, parameters of the model, settings and processes of forces may be wrong if
nothing is said."""

CORRELATED = 1.5
"""Standard deviation of a correlation on the logistic scale: from -0.9 to 0.9 nearly alike."""

UNKNOWN = 50.0
"""Standard deviation of a logarithm of which nothing is known: next to no weight, but enough for a
direction in which the data say nothing either."""


def sensor_deviations(
    free: Free, entry: str, estimator: AbstractEstimator, model: Model
) -> list[Unknown]:
    """Standard deviations of the sensors."""
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model, singular=True)))
    return _each(free, "sigma_y", entry, model.outputs, sigma)


def walking_deviations(
    free: Free, entry: str, estimator: AbstractEstimator, model: Model
) -> list[Unknown]:
    """Steps of the states that walk."""
    noise = estimator.assumed[0]
    if noise.sigma_w is None:
        raise TuningError("the process noise is not given by sigma_w: free Q or Qc")
    sigma = np.sqrt(np.diag(noise.stated_process(model)))
    return _each(free, "walk", entry, model.states, sigma)


def prior_deviations(
    free: Free, entry: str, estimator: AbstractEstimator, model: Model
) -> list[Unknown]:
    """Standard deviations of the prior."""
    sigma = np.sqrt(np.diag(estimator.assumed[1].covariance(model)))
    return _each(free, "sigma_x0", entry, model.states, sigma)


def _each(
    free: Free, kind: Kind, entry: str, of: Sequence[Signal], sigma: np.ndarray
) -> list[Unknown]:
    """One standard deviation by the name of its signal, or all that are not zero."""
    group = free.name.partition(".")[0]
    known = dict(zip((s.name for s in of), map(float, sigma), strict=True))
    units = {s.name: s.unit for s in of}
    if entry and entry not in known:
        raise TuningError(f"'{free.name}' cannot be free: {nearest(entry, known)}")
    chosen = [entry] if entry else [n for n, v in known.items() if v > 0]
    return [
        _positive(free, kind, f"{group}.{n}", f"{group}.{n}", known[n], LOOSE, units[n])
        for n in chosen
    ]


def start_values(
    free: Free, entry: str, estimator: AbstractEstimator, model: Model
) -> list[Unknown]:
    """Start values."""
    prior = estimator.assumed[1]
    mean, sigma = prior.mean(model), np.sqrt(np.diag(prior.covariance(model)))
    states = {s.name: i for i, s in enumerate(model.states)}
    if entry and entry not in states:
        raise TuningError(f"'{free.name}' cannot be free: {nearest(entry, states)}")
    found = []
    for name in [entry] if entry else states:
        i, size = states[name], free.sigma or float(sigma[states[name]])
        if size > 0:
            scale = LinearScale(float(mean[i]), size)
            unit = model.states[i].unit
            found.append(Unknown(f"x0.{name}", "x0", name, scale, 1.0, free.per, unit))
    if not found:
        raise TuningError(
            f"'{free.name}' cannot be free: sigma_x0 says that it is known; give sigma"
        )
    return found


def whole_factor(
    free: Free, entry: str, estimator: AbstractEstimator, model: Model
) -> list[Unknown]:
    """A factor of all of `R` or `P0`."""
    del estimator, model
    if entry:
        raise TuningError(f"'{free.name}' cannot be free: say sigma_y or sigma_x0 for one entry")
    kind: Kind = "R" if free.name == "R" else "P0"
    return [_positive(free, kind, free.name, free.name, 1.0, LOOSE)]


def walk_entry(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    """`Q` or `Qc`: a factor, or one entry of the diagonal."""
    noise, (group, _, _) = estimator.assumed[0], free.name.partition(".")
    given = noise.stated_density(model) if group == "Qc" else noise.stated_process(model)
    if not given.any():
        raise TuningError(f"'{free.name}' cannot be free: the noise has no {group}")
    if not entry:
        return [_positive(free, "walk", group, group, 1.0, LOOSE**2)]
    states = [s.name for s in model.states]
    if entry not in states:
        raise TuningError(f"'{free.name}' cannot be free: {nearest(entry, states)}")
    i = states.index(entry)
    if np.count_nonzero(given[i]) > 1:
        raise TuningError(f"'{free.name}' is correlated with other states: free '{group}'")
    return [_positive(free, "walk", free.name, free.name, float(given[i, i]), LOOSE**2)]


def matrix_entries(free: Free, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    """Variances and correlations of a covariance with a structure."""
    noise = estimator.assumed[0]
    if free.name == "R":
        start, of = noise.measurement(model), model.outputs
    else:
        stated = noise.stated_density if free.name == "Qc" else noise.stated_process
        start, of = stated(model), model.states
    names = [s.name for s in of]
    matrix = blocks_of(free.name, names, np.diag(start), free.structure)
    numbers = matrix.numbers(start)
    found = []
    for i, j in matrix.entries:
        name = matrix.name(i, j)
        scale: AbstractScale = LogScale(numbers[name])
        spread = min(math.log(free.spread or LOOSE**2), UNKNOWN)
        if i != j:
            scale, spread = BoundedScale(numbers[name], -1.0, 1.0), min(CORRELATED, spread)
        found.append(Unknown(name, "matrix", name, scale, spread, free.per, matrix=matrix))
    return found


def channel_delay(free: Free, entry: str, model: Model) -> Unknown:
    """By how much the samples of a channel come late."""
    inputs, outputs = ([s.name for s in k] for k in (model.inputs, model.outputs))
    if entry not in (*inputs, *outputs):
        raise TuningError(f"'{free.name}' cannot be free: {nearest(entry, [*inputs, *outputs])}")
    if entry in inputs and entry in outputs:
        raise TuningError(f"'{free.name}' is an input and an output; rename one")
    if len(outputs) == 1 and not inputs:
        raise TuningError(f"'{free.name}' cannot be free: there is no other channel")
    if entry in outputs and len(outputs) > 1 and not model.continuous:
        raise TuningError(f"'{free.name}': the delay of one output of several needs rates")
    if free.sigma is None:
        raise TuningError(
            f"'{free.name}' starts at 0: say how large it may be in seconds, "
            f"Free('{free.name}', sigma=...)"
        )
    # If the only output is late, all inputs are early, and these have no noise to be smoothed.
    kind = "u" if entry in inputs else "y" if len(outputs) > 1 else "only"
    scale = LinearScale(0.0, free.sigma)
    return Unknown(free.name, "delay", f"{kind}.{entry}", scale, 1.0, free.per, "s")


def model_parameter(free: Free, model: Model) -> Unknown:
    """A parameter of the model that is no state."""
    s = next(s for s in model.parameters if s.name == free.name)
    if not s.lower < s.value < s.upper:
        raise TuningError(f"'{s.name}' starts at its bound {s.value:g}: start inside")
    if (
        s.value == 0
        and free.sigma is None
        and not (math.isfinite(s.lower) or math.isfinite(s.upper))
    ):
        raise TuningError(f"'{s.name}' starts at 0: give Free('{s.name}', sigma=...)")
    scale = scale_of(s.value, s.lower, s.upper, unit=free.sigma)
    spread = min(math.log(free.spread or PHYSICAL), UNKNOWN)
    if free.sigma is not None:
        spread = free.sigma / abs(scale.slope(0.0))
    return Unknown(s.name, "parameter", s.name, scale, spread, free.per, s.unit)


def process_numbers(free: Free, force: str, entry: str, model: Model) -> list[Unknown]:
    """Size, scale of time, frequency and memory of the process that a force follows."""
    process = followed_process(model, force)
    numbers = {f.name: getattr(process, f.name) for f in dataclasses.fields(process)}
    numbers = {n: v for n, v in numbers.items() if isinstance(v, float) and math.isfinite(v)}
    if "length" in numbers and entry == "time":
        entry = "length"  # as that of Gauss and Markov is called
    if entry and entry not in numbers:
        raise TuningError(f"'{free.name}' cannot be free: {nearest(entry, numbers)}")
    unit = next(s.unit for s in model.states if s.name == force)
    units = {"sigma": unit, "length": "s", "memory": "s", "frequency": "Hz"}
    return [
        _positive(free, "process", name, name, numbers[n], PROCESS, units.get(n, ""))
        for n in ([entry] if entry else ("sigma", "length"))
        for name in (f"{force}.{n}",)
        if n in numbers
    ]


def _positive(
    free: Free, kind: Kind, name: str, entry: str, start: float, loose: float, unit: str = ""
) -> Unknown:
    if not start > 0:
        raise TuningError(f"'{name}' starts at {start:g}: give a start value above 0")
    spread = min(math.log(free.spread or loose), UNKNOWN)
    if free.sigma is not None:
        spread = free.sigma / start
    return Unknown(name, kind, entry, LogScale(start), spread, free.per, unit)


def estimator_setting(free: Free, estimator: AbstractEstimator) -> Unknown:
    """A number among the settings, within the range of its field, or a factor of several."""
    if free.name in estimator.fixed_settings:
        raise TuningError(f"'{free.name}' cannot be free: {estimator.fixed_settings[free.name]}")
    if several(estimator, free.name):
        with_number(estimator, free.name, 1.0)  # raises if they cannot be changed so
        return _positive(free, "setting", free.name, free.name, 1.0, SETTING)
    start, (lower, upper) = number_at(estimator, free.name), range_at(estimator, free.name)
    if isinstance(start, int):
        raise TuningError(
            f"'{free.name}' is a whole number: give Choice('{free.name}', (...)) instead"
        )
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return _positive(free, "setting", free.name, free.name, start, SETTING)
    if not lower < start < upper:
        raise TuningError(f"'{free.name}' starts at its bound {start:g}: start inside")
    scale = BoundedScale(start, lower, upper)
    spread = min(math.log(free.spread or SETTING), UNKNOWN)
    return Unknown(free.name, "setting", free.name, scale, spread, free.per)
