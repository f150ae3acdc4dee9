"""Numbers among the settings of an estimator, by their paths: ``alpha``, ``arrival.forgetting``."""

import dataclasses
import math
import typing
from typing import Any

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
        if isinstance(value, int | float) and not isinstance(value, bool):
            found.append(prefix)
        elif isinstance(value, Description):
            found += [f"{prefix}.{inner}" for inner in numeric_settings(value)]
    return found


def number_at(description: Description, path: str) -> float:
    """Value of a setting."""
    value: object = description
    for name in path.split("."):
        value = getattr(value, name)
    if not isinstance(value, int | float):
        raise TuningError(f"'{path}' is no number")
    return value


def range_at(description: Description, path: str) -> tuple[float, float]:
    """Ends of the numbers that the field of a setting may be."""
    *above, name = path.split(".")
    owner: object = description
    for part in above:
        owner = getattr(owner, part)
    hint = typing.get_type_hints(type(owner), include_extras=True)[name]
    ranges = [extra for extra in typing.get_args(hint)[1:] if isinstance(extra, Range)]
    return (ranges[0].lower, ranges[0].upper) if ranges else (-math.inf, math.inf)


def with_setting(description: Any, path: str, value: Any) -> Any:
    """The same description with another value of a setting."""
    name, _, rest = path.partition(".")
    if rest:
        value = with_setting(getattr(description, name), rest, value)
    return dataclasses.replace(description, **{name: value})
