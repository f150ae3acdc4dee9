"""Numbers among the settings of an estimator, by their paths: ``alpha``, ``arrival.forgetting``.

Of a setting by name each name is a path, ``sigma_force.hit``; a setting of several numbers without
names has the path of all, and the number of it is the factor by which they are changed.
"""

import dataclasses
import math
import typing
from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.description import Description, Range
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.uncertainty import Noise, Prior


def numeric_settings(description: Any) -> list[str]:
    """Paths of all numbers of an estimator and of the parts it is made of."""
    found = []
    for field in dataclasses.fields(description):
        value = getattr(description, field.name)
        if isinstance(value, Noise) and isinstance(description, AbstractEstimator):
            value = value.outliers
            prefix = "noise.outliers"
        elif isinstance(value, Prior):
            continue
        else:
            prefix = field.name
        if _is_number(value):
            found.append(prefix)
        elif isinstance(value, Mapping):
            found += [f"{prefix}.{name}" for name, v in value.items() if _is_number(v)]
        elif isinstance(value, Description):
            found += [f"{prefix}.{inner}" for inner in numeric_settings(value)]
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def several(estimator: AbstractEstimator, path: str) -> bool:
    """Whether a path is that of several numbers, which a factor changes."""
    return path in estimator.multiplied_settings


def number_at(estimator: Any, path: str) -> float:
    """Value of a setting; 1, the factor, of several."""
    value: object = estimator
    for name in path.split("."):
        value = value[name] if isinstance(value, Mapping) else getattr(value, name)
    if isinstance(estimator, AbstractEstimator) and several(estimator, path):
        return 1.0
    if not isinstance(value, int | float):
        raise TuningError(f"'{path}' is no number")
    return value


def range_at(description: Description, path: str) -> tuple[float, float]:
    """Ends of the numbers that the field of a setting may be."""
    *above, name = path.split(".")
    owner: object = description
    for part in above:
        inner = getattr(owner, part)
        if isinstance(inner, Mapping):
            name = part
            break
        owner = inner
    hint = typing.get_type_hints(type(owner), include_extras=True)[name]
    ranges = [extra for extra in typing.get_args(hint)[1:] if isinstance(extra, Range)]
    return (ranges[0].lower, ranges[0].upper) if ranges else (-math.inf, math.inf)


def with_setting(description: Any, path: str, value: Any) -> Any:
    """The same description with another value of a setting."""
    name, _, rest = path.partition(".")
    if isinstance(description, Mapping):
        return {**description, name: value}
    if rest:
        value = with_setting(getattr(description, name), rest, value)
    return dataclasses.replace(description, **{name: value})


def with_number(estimator: AbstractEstimator, path: str, value: float) -> AbstractEstimator:
    """The same estimator with another number at a path, see `number_at`."""
    if several(estimator, path):
        return with_setting(estimator, path, _multiplied(getattr(estimator, path), value))
    return with_setting(
        estimator, path, round(value) if isinstance(number_at(estimator, path), int) else value
    )


def _multiplied(given: Any, factor: float) -> Any:
    """An array times a factor; poles from sample to sample whose errors fade so many times as fast.

    Raises
    ------
    TuningError
        If a pole has no speed.
    """
    if not isinstance(given, tuple):
        return factor * np.asarray(given, float)
    for pole in given:
        if pole.real < 0 and not pole.imag:
            raise TuningError(
                f"the pole {pole.real:g} changes its sign from sample to sample, which is no speed "
                "that a factor could change; start with poles between 0 and 1"
            )
    return tuple(_power(pole, factor) for pole in given)


def _power(pole: complex, factor: float) -> complex:
    """A pole to a power; that of a conjugate is the conjugate, to the last bit."""
    if not pole.imag:
        return complex(pole.real**factor)
    upper = complex(pole.real, abs(pole.imag)) ** factor
    return upper if pole.imag > 0 else upper.conjugate()
