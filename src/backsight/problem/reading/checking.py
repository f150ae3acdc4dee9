"""Check a table of the file and say in one line what is wrong, by key."""

import contextlib
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
    "greater_than_equal": "is {}; it must not be negative",
}
"""What is wrong, by pydantic's kind of error; the braces stand for what was given."""


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
    return f"{key or 'the file'}: {reason.format(shown_value(error['input']))}"


def _keys(kind: type[StrictTable], place: Sequence[int | str]) -> list[str]:
    """Return the keys of the table at a place inside another."""
    inner: Any = kind
    for part in place:
        if isinstance(inner, type) and issubclass(inner, StrictTable):
            inner = inner.model_fields[str(part)].annotation
        else:
            inner = typing.get_args(inner)[-1]
        options = [a for a in typing.get_args(inner) if isinstance(a, type)]
        if options and issubclass(options[0], StrictTable):
            inner = options[0]
    return list(inner.model_fields)
