"""Estimator and model with other values in the places of the free ones."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.forces.changing import followed_process, with_process
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune.fitting.values._matrix import matrices_of
from backsight.tune.fitting.values._settings import with_number
from backsight.tune.fitting.values._unknown import Unknown
from backsight.types import Array

LEAST = 1e-3
"""Share of a variance that is left to a sensor whose readings are rounded, at least."""


def placed(
    estimator: AbstractEstimator,
    model: Model,
    unknowns: Sequence[Unknown],
    values: Mapping[str, float],
) -> tuple[AbstractEstimator, Model]:
    """Estimator and model with the values of all unknowns by their names."""
    changes: dict[str, Any] = {}
    kinds = {u.kind for u in unknowns}
    if kinds & {"sigma_y", "R", "walk", "matrix"}:
        changes["noise"] = _noise(estimator.assumed[0], model, unknowns, values)
    if kinds & {"sigma_x0", "P0", "x0"}:
        changes["prior"] = _prior(estimator.assumed[1], model, unknowns, values)
    if changes:
        estimator = dataclasses.replace(estimator, **changes)
    for u in unknowns:
        if u.kind == "setting":
            estimator = with_number(estimator, u.entry, values[u.name])
    given = {u.entry: values[u.name] for u in unknowns if u.kind == "parameter"}
    for u in unknowns:
        if u.kind == "process":
            force, _, number = u.entry.rpartition(".")
            changed = dataclasses.replace(
                followed_process(model, force), **{number: values[u.name]}
            )
            model = with_process(model, force, changed)
    return estimator, _with_parameters(model, given) if given else model


def sensor_factors(model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]) -> Array:
    """Factor of the standard deviation of every output, (ny,)."""
    factor = np.ones(model.ny)
    for u in unknowns:
        if u.kind == "R":
            factor *= np.sqrt(values[u.name])
        if u.kind == "sigma_y":
            factor[_place(u.entry, model.outputs)] = values[u.name] / u.start
    return factor


def walk_parts(noise: Noise, model: Model, unknown: Unknown) -> tuple[str, Array]:
    """Whether a part of the process noise is a ``Q`` or a ``Qc``, and the part as it is given."""
    group, _, state = unknown.entry.partition(".")
    word = "Qc" if group == "Qc" else "Q"
    whole = noise.stated_density(model) if word == "Qc" else noise.stated_process(model)
    if not state:
        return word, whole
    part = np.zeros_like(whole)
    i = _place(unknown.entry, model.states)
    part[i, i] = whole[i, i]
    return word, part


def walk_factor(unknown: Unknown, value: float) -> float:
    """Factor of the standard deviation of a part of the process noise."""
    ratio = value / unknown.start
    return ratio if unknown.entry.startswith("sigma_w") else float(np.sqrt(ratio))


def _noise(
    noise: Noise, model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]
) -> Noise:
    changes: dict[str, Any] = {}
    if any(u.kind in ("sigma_y", "R") for u in unknowns):
        factor = sensor_factors(model, unknowns, values)
        R = _without_rounding(
            noise.measurement(model, singular=True) * np.outer(factor, factor), model
        )
        if noise.R is not None:
            changes["R"] = R
        else:
            changes["sigma_y"] = _by_name(model.outputs, np.sqrt(np.diag(R)))
    for matrix in matrices_of(unknowns):
        found = matrix.matrix(values)
        if matrix.word == "R":
            changes |= {"sigma_y": None, "R": _without_rounding(found, model)}
        else:
            changes |= {"sigma_w": None, matrix.word: found}
    walks = [u for u in unknowns if u.kind == "walk"]
    if walks:
        whole = noise.stated_process(model) + noise.stated_density(model)
        for u in walks:
            part, f = walk_parts(noise, model, u)[1], walk_factor(u, values[u.name])
            whole = whole + (f**2 - 1) * part
        if noise.sigma_w is not None:
            walking = {n: v for n, v in _by_name(model.states, _roots(whole)).items() if v > 0}
            changes["sigma_w"] = walking
        else:
            changes["Qc" if noise.Qc is not None else "Q"] = whole
    return dataclasses.replace(noise, **changes)


def _without_rounding(R: Array, model: Model) -> Array:
    """What of a covariance is left beside the rounding of readings, which `measurement` adds."""
    steps = np.array([0.0 if s.resolution is None else s.resolution for s in model.outputs])
    left = np.maximum(np.diag(R) - steps**2 / 12, LEAST * np.diag(R))
    return R - np.diag(np.diag(R) - left)


def _prior(
    prior: Prior, model: Model, unknowns: Sequence[Unknown], values: Mapping[str, float]
) -> Prior:
    P0, x0 = prior.covariance(model), prior.mean(model)
    factor = np.ones(model.nx)
    for u in unknowns:
        if u.kind == "P0":
            factor *= np.sqrt(values[u.name])
        if u.kind == "sigma_x0":
            factor[_place(u.entry, model.states)] = values[u.name] / u.start
        if u.kind == "x0":
            x0[_place(u.entry, model.states)] = values[u.name]
    # A start value cannot be outside the bounds of its state.
    x0 = np.clip(x0, [s.lower for s in model.states], [s.upper for s in model.states])
    changes: dict[str, Any] = {"x0": _by_name(model.states, x0)}
    if prior.P0 is not None:
        changes["P0"] = P0 * np.outer(factor, factor)
    else:
        changes["sigma_x0"] = _by_name(model.states, factor * np.sqrt(np.diag(P0)))
    return dataclasses.replace(prior, **changes)


def _with_parameters(model: Model, given: Mapping[str, float]) -> Model:
    parameters = [
        dataclasses.replace(s, value=float(given.get(s.name, s.value))) for s in model.parameters
    ]
    return dataclasses.replace(model, parameters=tuple(parameters))


def _roots(Q: Array) -> Array:
    return np.sqrt(np.diag(Q))


def _by_name(of: Sequence[Signal], values: Array) -> dict[str, float]:
    return {s.name: float(v) for s, v in zip(of, values, strict=True)}


def _place(entry: str, of: Sequence[Signal]) -> int:
    """Position of a signal that an entry ends with."""
    name = entry.rpartition(".")[2]
    return next(i for i, s in enumerate(of) if s.name == name)
