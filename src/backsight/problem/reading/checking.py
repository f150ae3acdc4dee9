"""Check a table of the file and say in one line what is wrong, by key."""

import contextlib
import types
import typing
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import pydantic

from backsight.errors import BacksightError, ProblemError, nearest
from backsight.problem.reading.tables import StrictTable

AnyTable = TypeVar("AnyTable", bound=StrictTable)

_REASONS = {
    "missing": "is missing",
    "float_type": "must be a number, not {}",
    "finite_number": "must be a finite number, not {}",
    "int_type": "must be a whole number, not {}",
    "int_from_float": "must be a whole number, not {}",
    "string_type": "must be text in quotes, not {}",
    "bool_type": "must be true or false, not {}",
    "list_type": "must be a list, not {}",
    "dict_type": "must be a table, not {}",
    "model_type": "must be a table, not {}",
    "too_short": "is empty; at least one entry is needed",
    "greater_than_equal": "is {}; it must be at least {ge:g}",
    "less_than_equal": "is {}; it must be at most {le:g}",
}
"""What is wrong, by pydantic's kind of error; braces stand for what was given, and for limits."""


def validated(kind: type[AnyTable], given: object, *, where: str = "") -> AnyTable:
    """Validate a table.

    Raises `ProblemError` with all that is wrong, each with its key; `where` is the key of the table
    itself.
    """
    try:
        return kind.model_validate(given)
    except pydantic.ValidationError as error:
        lines = [_line(e, kind, where) for e in error.errors(include_url=False)]
        raise ProblemError("; ".join(lines)) from None


@contextlib.contextmanager
def at(where: str) -> Iterator[None]:
    """Put a key in front of the errors of a block."""
    try:
        yield
    except ProblemError:
        raise
    except BacksightError as error:
        raise ProblemError(f"{where}: {error.bare or error}") from None


def shown_value(value: object) -> str:
    """Return a value of the file as a message shows it."""
    match value:
        case bool():
            return str(value).lower()
        case dict():
            return "a table"
        case list():
            return "a list"
        case str():
            return f"'{value}'"
    return str(value)


def _line(error: Any, kind: type[StrictTable], where: str) -> str:
    place = error["loc"]
    key = ".".join([where, *map(str, place)] if where else map(str, place))
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key, {nearest(place[-1], _keys(kind, place[:-1]))}"
    reason = _REASONS.get(error["type"], f"{error['msg'].lower()}, not {{}}")
    said = reason.format(shown_value(error["input"]), **error.get("ctx", {}))
    return f"{key or 'the file'}: {said}"


def _keys(kind: type[StrictTable], place: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at a place inside another, none if there is no table."""
    inner: list[Any] = [kind]
    for part in place:
        inner = [found for one in inner for found in _inside(one, part)]
    return [name for one in inner if _is_table(one) for name in one.model_fields]


def _inside(kind: Any, part: int | str) -> list[Any]:
    """What may be at a key of a table, or in a list or a table of any keys."""
    if not _is_table(kind):
        return [found for one in typing.get_args(kind)[-1:] for found in _alternatives(one)]
    # A place also names the alternative that was tried, as MatrixTable: it is where it was.
    field = kind.model_fields.get(str(part))
    return [kind] if field is None else _alternatives(field.annotation)


def _alternatives(kind: Any) -> list[Any]:
    of_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    return list(typing.get_args(kind)) if of_union else [kind]


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, StrictTable)
