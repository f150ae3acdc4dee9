"""Short trees: how descriptions, models and findings print."""

import dataclasses
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backsight.description._html import preformatted

ROWS = 9
"""Lines of a tree below its head."""

WIDTH = 68
"""Characters of a row's text."""

ENTRIES = 6
"""Entries of a sequence that are shown."""


def tree(head: str, rows: Sequence[tuple[str, str]]) -> str:
    """Draw a head and its named rows, one line each.

    Parameters
    ----------
    head : str
    rows : sequence of (name, text)
        The names are put in one column.
    """
    width = max((len(name) for name, _ in rows), default=0)
    lines = [
        f"{'└' if k == len(rows) else '├'}── {name:<{width}}  {text}".rstrip()
        for k, (name, text) in enumerate(rows, start=1)
    ]
    return "\n".join(_on_one_line(line) for line in (head, *lines))


def short(value: object) -> str:
    """Return a value in a few words: numbers with four digits, sequences by their first entries."""
    match value:
        case None | bool():
            return str(value)
        case str():
            return value if value.isprintable() else repr(value)
        case complex() if value.imag == 0:
            return f"{value.real:.4g}"
        case int() | np.integer():
            return str(value)
        case float() | complex() | np.number():
            return f"{value:.4g}"
        case np.ndarray():
            return _array(value)
        case dict():
            return _some([f"{k} {short(v)}" for k, v in value.items()])
        case list() | tuple():
            return _some([short(v) for v in value])
    if type(value).__str__ not in (object.__str__, Printed.__str__):
        return next(iter(str(value).splitlines()), "")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        given = [f"{n} = {short(v)}" for n, v in fields.items() if not _nothing(v)]
        return f"{type(value).__name__}({', '.join(given)})"
    return f"a {type(value).__name__}"


def fields_tree(given: Any) -> str:
    """Draw the fields of a dataclass; if they are many, what is the default in one line."""
    kind: Any = type(given)
    fields = {f.name: getattr(given, f.name) for f in dataclasses.fields(kind)}
    rows = [(name, short(value)) for name, value in fields.items() if not _nothing(value)]
    if len(rows) > ROWS:
        # What was chosen comes first: the sort keeps the order otherwise.
        own = _chosen(given)
        rows.sort(key=lambda row: row[0] not in own)
        rest = ", ".join(f"{name} = {text}" for name, text in rows[ROWS - 1 :])
        rows = [*rows[: ROWS - 1], ("and", rest)]
    title = vars(kind).get("title")
    named = isinstance(title, str)
    head = f"{kind.__name__}: {title}" if named else kind.__name__
    return tree(head, [(name, _cut(text)) for name, text in rows])


class Printed:
    """Base of dataclasses that print as a tree of their fields, in a notebook as well.

    A class with an `__str__` of its own is shown by that.
    """

    def __str__(self) -> str:
        return fields_tree(self)

    def _repr_html_(self) -> str:
        return preformatted(str(self))


def _chosen(value: Any) -> set[str]:
    """Names of the fields that have no default, or another value than it."""
    found = set()
    for field in dataclasses.fields(value):
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        if default is dataclasses.MISSING or not _same(getattr(value, field.name), default):
            found.add(field.name)
    return found


def _nothing(value: object) -> bool:
    return value is None or (isinstance(value, tuple | list | Mapping) and not value)


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return a is b
    try:
        return bool(a == b)
    except ValueError:  # arrays inside
        return False


def _array(values: np.ndarray) -> str:
    if values.ndim == 0:
        return short(values.item())
    if values.ndim == 1:
        return _some([short(v) for v in values])
    return " x ".join(map(str, values.shape)) + " array"


def _some(entries: Sequence[str]) -> str:
    more = f", ... {len(entries)} in all" if len(entries) > ENTRIES else ""
    return ", ".join(entries[:ENTRIES]) + more if entries else "none"


def _on_one_line(text: str) -> str:
    """Names come from files: a line break in one would draw a branch that is not there."""
    return "".join(c if c.isprintable() else " " for c in text)


def _cut(text: str) -> str:
    return textwrap.shorten(text, WIDTH, placeholder=" ...")
