"""Numbers of a description that constants of its program follow, see `engine.program.following`."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np

from backsight.errors import BacksightError, EngineError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise, Prior, covariance_faults
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.types import Array

Changed: TypeAlias = tuple[AbstractEstimator, Model]

SIGMA, WALK, SPREAD, MEAN = "sigma_y", "sigma_w", "sigma_x0", "x0"
LOWER, UPPER = "lower", "upper"
PRIOR = (MEAN, SPREAD)
"""What counts before the first sample only."""

FAR = 0.2
"""Largest change for a trial, by the size of a number."""


@dataclasses.dataclass(frozen=True)
class Followed:
    """Settings of one kind.

    Parameters
    ----------
    name : str
        Field of the struct.
    signals : tuple of Signal
        Name, unit and default of each.
    sizes : (n,) array
        How much of a change is a large one, with the sign of the direction in which it is allowed.
    change : callable
        ``(estimator, model, values) -> (estimator, model)`` with other values.
    """

    name: str
    signals: tuple[Signal, ...]
    sizes: Array
    change: Callable[[AbstractEstimator, Model, Array], Changed]

    @property
    def values(self) -> Array:
        """The defaults, (n,)."""
        return np.array([s.value for s in self.signals])

    def trials(self, rng: np.random.Generator) -> Array:
        """Three choices of the values near the defaults, (3, n)."""
        return self.values + self.sizes * rng.uniform(FAR / 8, FAR, (3, len(self.signals)))


def changeable(estimator: AbstractEstimator, model: Model) -> list[str]:
    """What of an estimator and its model may be asked for."""
    found = []
    try:
        noise, prior = estimator.assumed
    except BacksightError:
        pass
    else:
        found += [SIGMA] * (noisy(estimator, model) and not estimator.constant_gain)
        found += [WALK] * bool(np.any(noise.stated_process(model)))
        found += [SPREAD] * bool(np.any(prior.covariance(model))) + [MEAN]
    found += [LOWER] * any(math.isfinite(s.lower) for s in model.states)
    found += [UPPER] * any(math.isfinite(s.upper) for s in model.states)
    return [*found, *_numbers(estimator)]


def noisy(estimator: AbstractEstimator, model: Model) -> bool:
    """Whether all sensors have noise, which could be another one."""
    R = estimator.assumed[0].measurement(model, singular=True)
    return not any(covariance_faults(R, what="R", singular=False))


def followed(name: str, estimator: AbstractEstimator, model: Model) -> Followed:
    """Settings by their word, see `changeable`."""
    if name in (LOWER, UPPER):
        return _bounds(name, model)
    if name in _numbers(estimator):
        return _number(name, estimator)
    noise, prior = estimator.assumed
    if name == SIGMA:
        return _deviations(name, noise.measurement(model), model.outputs, _with_sensors)
    if name == WALK:
        return _deviations(name, noise.stated_process(model), model.states, _with_walks)
    if name == SPREAD:
        return _deviations(name, prior.covariance(model), model.states, _with_spread)
    return _mean(prior, model)


def _numbers(estimator: AbstractEstimator) -> list[str]:
    """Fields that are numbers, not counts."""
    fields = (f.name for f in dataclasses.fields(estimator))
    values = {name: getattr(estimator, name) for name in fields}
    return [n for n, v in values.items() if isinstance(v, float) and math.isfinite(v)]


def _number(name: str, estimator: AbstractEstimator) -> Followed:
    value = float(getattr(estimator, name))

    def change(other: AbstractEstimator, model: Model, values: Array) -> Changed:
        changes: dict[str, Any] = {name: float(values[0])}
        return dataclasses.replace(other, **changes), model

    return Followed(name, (Signal(value=value, name=name),), np.array([abs(value) or 1.0]), change)


def _deviations(
    name: str,
    covariance: Array,
    of: Sequence[Signal],
    change: Callable[[AbstractEstimator, Model, Array], Changed],
) -> Followed:
    """Standard deviations of a covariance that keeps its correlations; of what has any."""
    sigma = np.sqrt(np.diag(covariance))
    places = np.flatnonzero(sigma > 0).tolist()
    signals = tuple(Signal(of[i].unit, value=float(sigma[i]), name=of[i].name) for i in places)

    def scaled(estimator: AbstractEstimator, model: Model, values: Array) -> Changed:
        by = np.ones(len(sigma))
        by[places] = values / sigma[places]
        return change(estimator, model, covariance * np.outer(by, by))

    return Followed(name, signals, sigma[places], scaled)


def _with_sensors(estimator: AbstractEstimator, model: Model, R: Array) -> Changed:
    noise, _ = estimator.assumed
    # What rounds its readings has that noise by itself.
    steps = np.array([s.resolution or 0.0 for s in model.outputs])
    R = R - np.diag(steps**2 / 12)
    return _replaced(estimator, noise=dataclasses.replace(noise, sigma_y=None, R=R)), model


def _with_walks(estimator: AbstractEstimator, model: Model, Q: Array) -> Changed:
    noise, _ = estimator.assumed
    return _replaced(estimator, noise=dataclasses.replace(noise, sigma_w=None, Q=Q)), model


def _with_spread(estimator: AbstractEstimator, model: Model, P0: Array) -> Changed:
    _, prior = estimator.assumed
    return _replaced(estimator, prior=dataclasses.replace(prior, sigma_x0=None, P0=P0)), model


def _mean(prior: Prior, model: Model) -> Followed:
    mean, sigma = prior.mean(model), np.sqrt(np.diag(prior.covariance(model)))
    sizes = np.where(mean != 0, np.abs(mean), np.where(sigma > 0, sigma, 1.0))
    for i, s in enumerate(model.states):
        above, below = s.upper - mean[i], mean[i] - s.lower
        sizes[i] = min(sizes[i], above) if above >= below else -min(sizes[i], below)
    names = [s.name for s in model.states]
    signals = tuple(
        Signal(s.unit, value=float(v), name=s.name) for s, v in zip(model.states, mean, strict=True)
    )

    def change(estimator: AbstractEstimator, model: Model, values: Array) -> Changed:
        _, old = estimator.assumed
        x0 = dict(zip(names, map(float, values), strict=True))
        return _replaced(estimator, prior=dataclasses.replace(old, x0=x0)), model

    return Followed(MEAN, signals, sizes, change)


def _bounds(which: str, model: Model) -> Followed:
    """Lower or upper bounds; a trial is outside of them, where no start value is refused."""
    places = [i for i, s in enumerate(model.states) if math.isfinite(getattr(s, which))]
    bounds = np.array([getattr(model.states[i], which) for i in places])
    signals = tuple(
        Signal(model.states[i].unit, value=float(v), name=model.states[i].name)
        for i, v in zip(places, bounds, strict=True)
    )
    typical = np.array([model.states[i].scale or 1.0 for i in places])
    sizes = np.where(bounds != 0, np.abs(bounds), typical) * (-1.0 if which == LOWER else 1.0)

    def change(estimator: AbstractEstimator, other: Model, values: Array) -> Changed:
        states = list(other.states)
        for i, v in zip(places, values, strict=True):
            changes: dict[str, Any] = {which: float(v)}
            states[i] = dataclasses.replace(states[i], **changes)
        return estimator, dataclasses.replace(other, states=tuple(states))

    return Followed(which, signals, sizes, change)


def _replaced(
    estimator: AbstractEstimator, *, noise: Noise | None = None, prior: Prior | None = None
) -> AbstractEstimator:
    changes: dict[str, Any] = {
        k: v for k, v in (("noise", noise), ("prior", prior)) if v is not None
    }
    return dataclasses.replace(estimator, **changes)


def refusal(name: str, estimator: AbstractEstimator) -> EngineError | None:
    """Why a word that others know means nothing here, None if it is unknown everywhere."""
    title = estimator.title
    if name == SIGMA:
        return EngineError(
            f"{title} has no noise of its sensors that could be changed while it runs"
        )
    if name == WALK:
        return EngineError(
            f"{title} has no random walks that could be changed while it runs: its noise is given "
            "as Qc, or there is none"
        )
    if name in (LOWER, UPPER):
        return EngineError(f"no state has {'a' if name == LOWER else 'an'} {name} bound to change")
    return None
