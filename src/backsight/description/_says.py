"""What an annotation allows and what a value is, in the words of a message."""

import collections.abc
import numbers
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np

from backsight.description._ranges import Range

LONGEST = 60
"""Characters of a value that a message shows."""

NUMBERS: dict[Any, tuple[type, str]] = {
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    complex: (numbers.Complex, "a number, real or complex"),
}
"""Plain numbers: what Python and NumPy give for them, and what they are called."""


def plain(hint: Any) -> Any:
    """Return an annotation without what `Annotated` adds to it."""
    return typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint


def words(hint: Any) -> tuple[str, ...]:
    """Return the words that a `Literal`, or a union with one, allows; none of other annotations."""
    hint = plain(hint)
    if typing.get_origin(hint) is Literal:
        return typing.get_args(hint)
    return tuple(w for option in typing.get_args(hint) if is_union(hint) for w in words(option))


def described(hint: Any, within: Range | None = None) -> str:
    """Say what an annotation allows: ``a number``, ``'zoh' or 'foh'``, ``a Noise or None``."""
    if typing.get_origin(hint) is Annotated:
        first, *extras = typing.get_args(hint)
        return described(first, next((e for e in extras if isinstance(e, Range)), within))
    if hint in NUMBERS:
        number = NUMBERS[hint][1]
        return within.must.removeprefix("be ") if within and "number" in within.must else number
    if is_union(hint):
        return either(dict.fromkeys(described(o, within) for o in typing.get_args(hint)))
    if typing.get_origin(hint) is Literal:
        return either(map(repr, typing.get_args(hint)))
    if hint is None or hint is types.NoneType:
        return "None"
    named = {bool: "True or False", str: "text", collections.abc.Callable: "a function"}
    origin, args = typing.get_origin(hint) or hint, typing.get_args(hint)
    if origin in named:
        return named[origin]
    if origin is np.ndarray:
        return "an array of numbers"
    if args and isinstance(origin, type) and issubclass(origin, Mapping):
        return "a dict by name"
    if args and isinstance(origin, type) and issubclass(origin, Sequence):
        return f"a sequence of {many(typing.get_args(hint))}"
    name = origin.__name__ if isinstance(origin, type) else str(origin)
    article = "an" if name[0] in "AEIOULMN" and (name.isupper() or name[0] in "AEIOU") else "a"
    return f"{article} {name}"


def shown(value: object) -> str:
    """Return a value as a message shows it: in full if it is short."""
    if isinstance(value, type):
        return f"the class {value.__name__} (write {value.__name__}(...))"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray):
        return f"an array of the shape {value.shape}"
    if isinstance(value, str | bool | int | float | complex | tuple | list | dict | None):
        text = repr(value)
        return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
    return f"of the kind {type(value).__name__}"


def is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (types.UnionType, typing.Union)


def many(hints: Iterable[Any]) -> str:
    """What the entries of a sequence are: ``text``, ``a number``."""
    return either(dict.fromkeys(described(h) for h in hints))


def either(options: Iterable[str]) -> str:
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last
