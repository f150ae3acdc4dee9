"""Frozen descriptions (estimators, their parts) from tables whose keys are their fields."""

import contextlib
import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar

import numpy as np

from backsight.description import plain
from backsight.errors import ProblemError, nearest
from backsight.problem.reading.checking import at, shown_value
from backsight.types import Array

T = TypeVar("T")

_PLAIN = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    complex: 'a number, or text like "-1+2j"',
    str: "text in quotes",
}
"""Types of single values, and what they are called."""


def built(kind: type[T], given: Mapping[str, Any], *, where: str, fixed: Mapping[str, Any]) -> T:
    """Make a dataclass of a table.

    Fields that are dataclasses are tables in the table; of several possible ones, the class is
    named by the key ``kind``, or is the first. Arrays and tuples are lists.

    Parameters
    ----------
    kind : type
        A dataclass.
    given : mapping
        The table.
    where : str
        The key of the table, for messages.
    fixed : mapping
        Values of fields that are no keys of the table.

    Raises
    ------
    ProblemError
        If a key is unknown or missing, or a value is of the wrong kind or refused by the dataclass.
    """
    fields = {f.name: f for f in fields_of(kind) if f.name not in fixed}
    for name in given:
        if name not in fields:
            raise ProblemError(f"{where}.{name}: unknown key, {nearest(name, fields)}")
    for name, field in fields.items():
        if required(field) and name not in given:
            raise ProblemError(f"{where}.{name}: is missing")
    values = {n: _value(fields[n].type, v, f"{where}.{n}") for n, v in given.items()}
    with at(where):
        return kind(**fixed, **values)


def option_of(description: Any, path: str, given: object, *, where: str) -> object:
    """Read a value that a field of a description could have; as in `built`.

    Parameters
    ----------
    description : dataclass
    path : str
        Names of fields with dots between them.
    given : object
        As it stands in the file.
    where : str
        For messages.
    """
    *above, name = path.split(".")
    for part_name in above:
        description = getattr(description, part_name, None)
    fields = {f.name: f for f in fields_of(description)} if description is not None else {}
    if name not in fields:
        raise ProblemError(f"{where}: there is no setting '{path}', {nearest(name, fields)}")
    return _value(fields[name].type, given, where)


def fields_of(kind: Any) -> tuple[dataclasses.Field[Any], ...]:
    """Return the fields of a dataclass."""
    return dataclasses.fields(kind)


def required(field: dataclasses.Field[Any]) -> bool:
    """Whether a field has no default."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def dataclasses_in(annotation: Any) -> list[type]:
    """Return the dataclasses that a field may hold."""
    annotation = plain(annotation)
    options = map(plain, typing.get_args(annotation) if _is_union(annotation) else [annotation])
    return [o for o in options if isinstance(o, type) and dataclasses.is_dataclass(o)]


def _value(annotation: Any, given: object, where: str) -> object:
    annotation = plain(annotation)
    parts = dataclasses_in(annotation)
    if parts and isinstance(given, Mapping):
        return part(parts, given, where=where)
    if _is_union(annotation):
        options = [plain(o) for o in typing.get_args(annotation)]
        options = [o for o in options if o not in (*parts, types.NoneType)]
        lists = [o for o in options if typing.get_origin(o)]
        return _first_that_fits(
            lists if isinstance(given, list) and lists else options, given, where
        )
    if parts:
        raise ProblemError(f"{where}: must be a table, not {shown_value(given)}")
    origin = typing.get_origin(annotation)
    if origin is Literal:
        # Which words are known is the description's own to say.
        return _single(str, given, where)
    if origin is np.ndarray:
        return _array(given, where)
    if origin is tuple and isinstance(given, Sequence) and not isinstance(given, str):
        kind = typing.get_args(annotation)[0]
        return tuple(_value(kind, entry, f"{where}[{i}]") for i, entry in enumerate(given))
    if origin is Mapping and isinstance(given, Mapping):
        kind = typing.get_args(annotation)[1]
        return {name: _value(kind, entry, f"{where}.{name}") for name, entry in given.items()}
    if origin in (tuple, Mapping):
        what = "a list" if origin is tuple else "a table"
        raise ProblemError(f"{where}: must be {what}, not {shown_value(given)}")
    return _single(annotation, given, where)


def part(parts: Sequence[type[T]], given: Mapping[str, Any], *, where: str) -> T:
    """Make one of several dataclasses of a table; the key ``kind`` names it, else it is the first.

    Errors as in `built`.
    """
    named = {part.__name__: part for part in parts}
    rest = dict(given)
    name = rest.pop("kind", parts[0].__name__) if len(parts) > 1 else parts[0].__name__
    if not isinstance(name, str) or name not in named:
        raise ProblemError(
            f"{where}.kind: unknown kind {shown_value(name)}, {nearest(str(name), named)}"
        )
    return built(named[name], rest, where=where, fixed={})


def _first_that_fits(options: Sequence[Any], given: object, where: str) -> object:
    problems = []
    for option in options:
        try:
            return _value(option, given, where)
        except ProblemError as error:
            problems.append(error)
    raise (
        problems[0]
        if problems
        else ProblemError(f"{where}: must be a table, not {shown_value(given)}")
    )


def _single(kind: Any, given: object, where: str) -> object:
    if kind not in _PLAIN:
        raise ProblemError(f"{where}: cannot be given in a problem file")
    if type(given) is kind:
        return given
    if kind in (float, complex) and isinstance(given, int | float) and not isinstance(given, bool):
        return float(given)
    if kind is complex and isinstance(given, str):
        with contextlib.suppress(ValueError):
            return complex(given.replace(" ", ""))
    raise ProblemError(f"{where}: must be {_PLAIN[kind]}, not {shown_value(given)}")


def _array(given: object, where: str) -> Array:
    try:
        return np.array(given, float)
    except (TypeError, ValueError):
        raise ProblemError(f"{where}: must be a list of numbers, or of such lists") from None


def _is_union(annotation: Any) -> bool:
    return typing.get_origin(annotation) in (types.UnionType, typing.Union)
