"""Keys of a problem file with other values: one by one for a recording, many for a sweep."""

import copy
import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from backsight.errors import ProblemError
from backsight.fleet._tables import RangeTable
from backsight.problem.reading.checking import validated

Changes = tuple[tuple[str, Any], ...]
"""Dotted keys and what stands there instead."""

MOST_VALUES = 100_000
"""Values that a key, and settings that all keys together, may have."""


def names_file(key: str) -> bool:
    """Whether a key holds the path of a recording, or of another one beside it."""
    return key == "recording.path" or (
        key.startswith("recording.sources.") and key.endswith(".path")
    )


def changed(tree: Mapping[str, Any], changes: Changes) -> dict[str, Any]:
    """The tables of a problem file with other values; the key of one that is no table is named."""
    result = copy.deepcopy(dict(tree))
    for key, value in changes:
        *tables, last = key.split(".")
        inner = result
        for depth, name in enumerate(tables, 1):
            inner = inner.setdefault(name, {})
            if not isinstance(inner, dict):
                raise ProblemError(f"{key}: {'.'.join(tables[:depth])} is no table of the problem")
        inner[last] = copy.deepcopy(value)
    return result


def axes_of(sweep: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Key to its values; keys are dotted, or tables in tables, as TOML makes of bare ones.

    Raises
    ------
    ProblemError
        If something stands there that is neither a list nor a range.
    """
    axes = dict(_axes(sweep, ""))
    for key in filter(names_file, axes):
        raise ProblemError(f"sweep.{key}: which files there are is said by [recordings]")
    return axes


def _axes(table: Mapping[str, Any], above: str) -> Iterator[tuple[str, tuple[Any, ...]]]:
    for name, entry in table.items():
        key = f"{above}.{name}" if above else name
        match entry:
            case []:
                raise ProblemError(f"sweep.{key}: is empty; give a value or more")
            case list():
                yield key, tuple(entry)
            case {"from": _} | {"to": _}:
                yield key, _values(validated(RangeTable, entry, where=f"sweep.{key}"), key)
            case {**inner} if inner:
                yield from _axes(inner, key)
            case _:
                raise ProblemError(
                    f"sweep.{key}: give a list of values, or a range such as "
                    "{ from = 5, to = 25, step = 5 }"
                )


def _values(given: RangeTable, key: str) -> tuple[int | float, ...]:
    where, start, to = f"sweep.{key}", given.start, given.to
    if (given.step is None) == (given.count is None):
        raise ProblemError(f"{where}: give the step or the count")
    if given.scale == "log" and (given.step is not None or start <= 0 or to <= 0):
        raise ProblemError(f"{where}: scale = 'log' needs a count, and ends above zero")
    if given.step is not None:
        # A little more, so that rounding does not take the end away.
        count = int(abs(to - start) / given.step + 1 + 1e-9)
    else:
        count = given.count or 1
    if count > MOST_VALUES:
        raise ProblemError(f"{where}: has {count} values; at most {MOST_VALUES}")
    if given.step is not None:
        step = given.step if to >= start else -given.step
        # Products, so that no rounding adds up; whole numbers stay whole.
        return tuple(start + k * step for k in range(count))
    spaced = np.geomspace if given.scale == "log" else np.linspace
    return tuple(float(v) for v in spaced(start, to, count))


def settings_of(axes: Mapping[str, tuple[Any, ...]]) -> list[Changes]:
    """Every combination of the values of all keys; one without a change if there are no keys."""
    number = int(np.prod([len(values) for values in axes.values()], dtype=float)) if axes else 1
    if number > MOST_VALUES:
        raise ProblemError(f"sweep: has {number} settings; at most {MOST_VALUES}")
    return [tuple(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
