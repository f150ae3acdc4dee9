"""From payloads to numbers: JSON, lines of text, packed records, CBOR."""

import functools
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from backsight.errors import PluginError, ProblemError, nearest
from backsight.live.sources.base import Decode, Unreadable, wanted_columns
from backsight.problem.reading.tables import MessageTable
from backsight.types import Array

LONGEST = 2**20
"""Bytes of a payload at most."""

_PACKED = {"b": "i1", "B": "u1", "h": "i2", "H": "u2", "i": "i4", "I": "u4", "l": "i4", "L": "u4",
           "q": "i8", "Q": "u8", "e": "f2", "f": "f4", "d": "f8"}  # fmt: skip
"""Letters of Python's struct, standard sizes, in NumPy's words."""


def payload_decoder(feed: MessageTable, where: str) -> Decode:
    """Return what reads the payloads of a source.

    Raises
    ------
    ProblemError
        If the form of the payloads is not described, or has no such columns.
    PluginError
        If CBOR cannot be read here.
    """
    wanted = wanted_columns(feed)
    units = {c.column: c.unit for c in feed.columns_wanted.values() if c.unit}
    if feed.format == "json":
        return functools.partial(_objects, wanted=wanted, units=units, parse=_json)
    if feed.format == "cbor":
        return functools.partial(_objects, wanted=wanted, units=units, parse=_cbor())
    if not feed.columns:
        raise ProblemError(f"{where}.columns: is missing; name the numbers in their order")
    for name in wanted:
        if name not in feed.columns:
            raise ProblemError(f"{where}.columns: has no '{name}', {nearest(name, feed.columns)}")
    order = [feed.columns.index(name) for name in wanted]
    if feed.format == "text":
        delimiter = feed.delimiter.encode()
        return functools.partial(_lines, order=order, count=len(feed.columns), delimiter=delimiter)
    return functools.partial(_records, order=order, record=record_of(feed, where))


def record_of(feed: MessageTable, where: str) -> np.dtype:
    """Return the type of a packed record, one field for each column."""
    found = re.fullmatch(r"([<>])((?:\d*[bBhHiIlLqQefd])+)", feed.struct.replace(" ", ""))
    if found is None:
        raise ProblemError(
            f"{where}.struct: must be < or > (which byte comes first) and letters of Python's "
            f"struct such as d, f, i, h, not '{feed.struct}'"
        )
    fields = [
        found[1] + _PACKED[letter]
        for count, letter in re.findall(r"(\d*)(\w)", found[2])
        for _ in range(int(count or 1))
    ]
    if len(fields) != len(feed.columns):
        raise ProblemError(
            f"{where}.struct: holds {len(fields)} numbers, but there are {len(feed.columns)} "
            "columns"
        )
    return np.dtype([(f"f{k}", kind) for k, kind in enumerate(fields)])


def _records(
    payloads: Sequence[bytes], *, order: Sequence[int], record: np.dtype
) -> tuple[Array, np.ndarray, list[Unreadable]]:
    size = record.itemsize
    faults = [
        Unreadable(p, f"has {len(p)} bytes, not a multiple of {size}")
        for p in payloads
        if len(p) % size
    ]
    counts = np.array([0 if len(p) % size else len(p) // size for p in payloads])
    sound = np.frombuffer(b"".join(p for p in payloads if not len(p) % size), record)
    values = np.empty((len(sound), len(order)))
    with np.errstate(invalid="ignore"):  # not every NaN may be widened quietly
        for j, k in enumerate(order):
            values[:, j] = sound[f"f{k}"]
    return (
        *_without_infinite(values, np.repeat(np.arange(len(payloads)), counts), payloads, faults),
    )


def _lines(
    payloads: Sequence[bytes], *, order: Sequence[int], count: int, delimiter: bytes
) -> tuple[Array, np.ndarray, list[Unreadable]]:
    """Numbers between delimiters; an empty cell is "not measured"."""
    lines = [p.strip() for p in payloads]
    if all(line.count(delimiter) == count - 1 for line in lines):
        cells = delimiter.join(lines).split(delimiter)
        if not any(b"_" in line for line in lines):
            try:  # all lines at once, where nothing is wrong with any
                table = np.array(cells).astype(float).reshape(-1, count)
                return _without_infinite(table[:, order], np.arange(len(lines)), payloads, [])
            except ValueError:
                pass
    rows, owner, faults = [], [], []
    for k, line in enumerate(lines):
        if not line:
            continue
        cells = line.split(delimiter)
        if len(cells) != count:
            faults.append(Unreadable(line, f"has {len(cells)} numbers, not {count}"))
            continue
        try:
            rows.append([_number(cells[j]) for j in order])
            owner.append(k)
        except ValueError as error:
            faults.append(Unreadable(line, str(error)))
    values = np.array(rows).reshape(-1, len(order))
    return _without_infinite(values, np.array(owner, int), payloads, faults)


def _number(cell: bytes) -> float:
    text = cell.strip()
    if not text:
        return math.nan
    try:
        if b"_" in text:
            raise ValueError
        return float(text)
    except ValueError:
        raise ValueError(f"'{text.decode(errors='replace')[:40]}' is no number") from None


def _without_infinite(
    values: Array, owner: np.ndarray, payloads: Sequence[bytes], faults: list[Unreadable]
) -> tuple[Array, np.ndarray, list[Unreadable]]:
    bad = np.isinf(values).any(axis=1)
    if bad.any():
        faults = [
            *faults,
            *(Unreadable(payloads[k], "holds an infinite number") for k in owner[bad]),
        ]
        values, owner = values[~bad], owner[~bad]
    return values, owner, faults


def _objects(
    payloads: Sequence[bytes],
    *,
    wanted: Sequence[str],
    units: Mapping[str, str],
    parse: Callable[[bytes], Any],
) -> tuple[Array, np.ndarray, list[Unreadable]]:
    """Objects of names and numbers, or lists of them; a list of numbers is several samples."""
    parts, owner, faults = [], [], []
    for k, payload in enumerate(payloads):
        if not payload.strip():
            continue
        try:
            found = parse(payload)
            rows = [_rows_of(o, wanted, units) for o in (found if _is_list(found) else [found])]
        except (ValueError, TypeError, RecursionError, OverflowError) as error:
            faults.append(
                Unreadable(payload, str(error).partition("\n")[0] or type(error).__name__)
            )
            continue
        parts += rows
        owner += [k] * sum(map(len, rows))
    values = np.concatenate(parts) if parts else np.empty((0, len(wanted)))
    return _without_infinite(values, np.array(owner, int), payloads, faults)


def _is_list(found: object) -> bool:
    return isinstance(found, list)


def _rows_of(given: Any, wanted: Sequence[str], units: Mapping[str, str]) -> Array:
    if not isinstance(given, dict):
        raise ValueError("is no object of names and numbers")
    if not any(name in given for name in wanted):
        raise ValueError(f"has none of {', '.join(wanted)}")
    said = given.get("units")
    for name, unit in said.items() if isinstance(said, dict) else ():
        if name in units and unit != units[name]:
            raise ValueError(f"says that {name} is in {unit}, the problem file says {units[name]}")
    entries = [given.get(name) for name in wanted]
    length = max((len(e) for e in entries if isinstance(e, list)), default=1)
    rows = np.empty((length, len(wanted)))
    for j, (name, entry) in enumerate(zip(wanted, entries, strict=True)):
        cells = entry if isinstance(entry, list) else [entry] * length
        if len(cells) != length:
            raise ValueError(f"{name} has {len(cells)} numbers, others have {length}")
        rows[:, j] = [_plain(name, cell) for cell in cells]
    return rows


def _plain(name: str, cell: object) -> float:
    if cell is None:
        return math.nan
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        raise ValueError(f"{name} is {str(cell)[:40]!r}, no number")
    return float(cell)


def _json(payload: bytes) -> Any:
    try:
        return json.loads(payload)
    except ValueError:
        raise ValueError("is no JSON") from None


def _cbor() -> Callable[[bytes], Any]:
    try:
        import cbor2
    except ModuleNotFoundError:
        raise PluginError("CBOR needs cbor2: pip install 'backsight[live]'") from None

    def parse(payload: bytes) -> Any:
        try:
            return cbor2.loads(payload)
        except Exception as error:  # of whatever bytes may mean
            raise ValueError(f"is no CBOR: {error}") from None

    return parse
