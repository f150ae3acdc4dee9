"""What a problem file may be before anything is made of it: no time, no memory for nonsense.

A file from elsewhere is data. TOML itself sets hardly a limit: a few kilobytes can describe lists
in lists that no program can follow, names that would steer a terminal, or numbers of a million
digits.
"""

from collections.abc import Iterator
from typing import Any

from backsight.errors import ProblemError

MOST_BYTES = 20_000_000
"""Largest file; matrices of a thousand rows have a few million bytes."""

DEEPEST = 32
"""Most tables and lists inside each other."""

MOST_KEYS = 2000
"""Most entries of a table."""

LONGEST_KEY, LONGEST_TEXT = 200, 100_000
"""Characters of a key and of a text."""

LARGEST_INTEGER = 2**63
"""TOML promises so much."""


def check_keys(text: str) -> None:
    """Raise `ProblemError` if a key has so many parts that reading it would take minutes."""
    for number, line in enumerate(text.splitlines(), 1):
        parts = line.split("=")
        ends = len(parts) == 1 and line.lstrip().startswith("[") and "," not in line
        for part in parts if ends else parts[:-1]:
            if part.rpartition(",")[2].count(".") > 2 * DEEPEST:
                raise ProblemError(f"line {number}: a key has more than {DEEPEST} parts")


def check_tree(tree: dict[str, Any]) -> None:
    """Raise `ProblemError` if tables, lists, keys, texts or numbers are beyond all measure."""
    waiting: list[tuple[str, int, Any]] = [("", 0, tree)]
    while waiting:
        where, depth, value = waiting.pop()
        if depth > DEEPEST:
            raise ProblemError(f"{_short(where)}: tables and lists are more than {DEEPEST} deep")
        if isinstance(value, dict):
            if len(value) > MOST_KEYS:
                place = where or "the file"
                raise ProblemError(f"{place}: has {len(value)} entries; the limit is {MOST_KEYS}")
            for key in value:
                _check_key(key, where)
        waiting += [(inner, depth + 1, entry) for inner, entry in _inside(where, value)]
        _check_single(value, where)


def _inside(where: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, entry in value.items():
            yield (f"{where}.{key}" if where else key), entry
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield f"{where}[{k}]", entry


def _check_key(key: str, where: str) -> None:
    if len(key) > LONGEST_KEY:
        raise ProblemError(f"{where or 'the file'}: a key has {len(key)} characters")
    if not key.isprintable():
        raise ProblemError(f"{where or 'the file'}: the key {key!a} has control characters")


def _check_single(value: Any, where: str) -> None:
    if isinstance(value, str):
        if len(value) > LONGEST_TEXT:
            raise ProblemError(f"{where}: has {len(value)} characters; at most {LONGEST_TEXT}")
        for character in set(value):
            if (ord(character) < 32 and character not in "\n\r\t") or 127 <= ord(character) < 160:
                raise ProblemError(
                    f"{where}: has the control character U+{ord(character):04X}; write plain text"
                )
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise ProblemError(f"{where}: is a whole number of {value.bit_length()} bits; at most 64")


def _short(where: str) -> str:
    return where if len(where) <= LONGEST_KEY else f"{where[:LONGEST_KEY]}…"
