"""The values that a fit may change: found in estimator and model by their names."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from backsight.errors import TuningError, nearest
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.force_estimator import AbstractForceEstimator
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.tune.fitting.values._free import Free
from backsight.tune.fitting.values._scale import AbstractScale, LinearScale, LogScale, scale_of
from backsight.tune.fitting.values._settings import number_at, numeric_settings

Kind = Literal["sigma_y", "R", "walk", "sigma_x0", "P0", "x0", "parameter", "setting"]
"""What a value is; ``walk`` is all process noise: `sigma_w`, `Q`, `Qc` and entries of them."""

LOOSE, PHYSICAL, SETTING = 30.0, 3.0, 10.0
"""Factors by which noise, parameters of the model and settings may be wrong if nothing is said."""


UNKNOWN = 50.0
"""Standard deviation of a logarithm of which nothing is known: next to no weight, but enough for a
direction in which the data say nothing either."""


@dataclasses.dataclass(frozen=True)
class Unknown:
    """One value that a fit may change.

    Parameters
    ----------
    name : str
        As the user says it, ``sigma_y.q``.
    kind : Kind
    entry : str
        The signal, the matrix with the state (``Qc.v``), the parameter, or the path of the setting.
    scale : AbstractScale
    spread : float
        Standard deviation of the prior on the scale.
    per : "all", "recording" or tuple of str
        See `Free`.
    unit : str
    """

    name: str
    kind: Kind
    entry: str
    scale: AbstractScale
    spread: float
    per: Literal["all", "recording"] | tuple[str, ...]
    unit: str = ""

    @property
    def start(self) -> float:
        """Value before."""
        return self.scale.start


def unknowns_of(
    free: Sequence[Free], estimator: AbstractEstimator, model: Model
) -> tuple[Unknown, ...]:
    """Resolve names.

    Raises
    ------
    TuningError
        If a name is unknown or means two things, two of them mean the same, or a start value is
        none.
    """
    found = [u for f in free for u in _resolved(f, estimator, model)]
    if not found:
        raise TuningError("nothing is free: name a value, such as free=['sigma_y', 'sigma_w']")
    names = [u.name for u in found]
    twice = [n for i, n in enumerate(names) if n in names[:i]]
    if twice:
        raise TuningError(f"free names '{twice[0]}' twice")
    _refuse_overlaps(found)
    return tuple(found)


def _refuse_overlaps(found: Sequence[Unknown]) -> None:
    for whole, parts in (("R", "sigma_y"), ("P0", "sigma_x0")):
        kinds = {u.kind for u in found}
        if whole in kinds and parts in kinds:
            raise TuningError(f"'{whole}' and '{parts}' change the same covariance: free one")
    walks = [u.entry for u in found if u.kind == "walk"]
    for matrix in ("Q", "Qc"):
        if matrix in walks and len(walks) > 1:
            raise TuningError(
                f"'{matrix}' is a factor of all process noise: free nothing beside it"
            )


def _resolved(free: Free, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    group, _, entry = free.name.partition(".")
    readers = {
        "sigma_y": _sigma_y, "sigma_w": _sigma_w, "sigma_x0": _sigma_x0, "x0": _x0, "R": _factor,
        "P0": _factor, "Q": _walk, "Qc": _walk,
    }  # fmt: skip
    if group in readers:
        estimator.assumed  # noqa: B018 - raises if it has none
        return readers[group](free, entry, estimator, model)
    parameters = [s.name for s in model.parameters]
    settings = numeric_settings(estimator)
    if free.name in parameters and free.name in settings:
        raise TuningError(
            f"'{free.name}' is a parameter of the model and a setting of the estimator; rename it"
        )
    if free.name in parameters:
        return [_parameter(free, model)]
    if isinstance(estimator, AbstractForceEstimator) and free.name in ("lam", "threshold"):
        raise TuningError(
            f"'{free.name}' decides how many forces there are, which no likelihood can: use "
            "lambda_from_noise, lambda_from_whiteness or lambda_from_sensors, and propose_threshold"
        )
    if free.name in settings:
        start = number_at(estimator, free.name)
        if isinstance(start, int):
            raise TuningError(
                f"'{free.name}' is a whole number: give Choice('{free.name}', (...)) instead"
            )
        return [_positive(free, "setting", free.name, free.name, start, SETTING)]
    known = [*readers, *parameters, *settings]
    raise TuningError(f"'{free.name}' cannot be free: {nearest(free.name, known)}")


def _sigma_y(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    sigma = np.sqrt(np.diag(estimator.assumed[0].measurement(model)))
    return _each(free, "sigma_y", entry, model.outputs, sigma)


def _sigma_w(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    noise = estimator.assumed[0]
    if noise.sigma_w is None:
        raise TuningError("the process noise is not given by sigma_w: free Q or Qc")
    sigma = np.sqrt(np.diag(noise.process(model)))
    return _each(free, "walk", entry, model.states, sigma)


def _sigma_x0(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
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


def _x0(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
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


def _factor(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    del estimator, model
    if entry:
        raise TuningError(f"'{free.name}' cannot be free: say sigma_y or sigma_x0 for one entry")
    kind: Kind = "R" if free.name == "R" else "P0"
    return [_positive(free, kind, free.name, free.name, 1.0, LOOSE)]


def _walk(free: Free, entry: str, estimator: AbstractEstimator, model: Model) -> list[Unknown]:
    """`Q` or `Qc`: a factor, or one entry of the diagonal."""
    noise, (group, _, _) = estimator.assumed[0], free.name.partition(".")
    given = noise.density(model) if group == "Qc" else noise.process(model)
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


def _parameter(free: Free, model: Model) -> Unknown:
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


def _positive(
    free: Free, kind: Kind, name: str, entry: str, start: float, loose: float, unit: str = ""
) -> Unknown:
    if not start > 0:
        raise TuningError(f"'{name}' starts at {start:g}: give a start value above 0")
    spread = min(math.log(free.spread or loose), UNKNOWN)
    if free.sigma is not None:
        spread = free.sigma / start
    return Unknown(name, kind, entry, LogScale(start), spread, free.per, unit)
