"""Matrices of Nastran's OUTPUT4, as text or binary, full or sparse.

Source: MSC Nastran DMAP Programmer's Guide, module OUTPUT4, "File format".
"""

from __future__ import annotations

import collections
import dataclasses
import re
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy

from backsight.data.finite_elements.matrix import EPS, Matrix
from backsight.errors import DataError, nearest

_TEXT_HEAD = re.compile(rb"\s*(-?\d+)\s+(-?\d+)\s+(\d+)\s+([1-4])\s*([A-Za-z][\w ]{0,7}).*")
_BIG_ROWS = 65536
"""From so many rows on, strings of sparse columns have length and row in a word each."""

Column = tuple[int, np.ndarray]
"""First row, from 0 on, and values of a string of a column."""


@dataclasses.dataclass(frozen=True)
class _Head:
    columns: int
    rows: int
    kind: int
    name: str
    big: bool


def is_op4(head: bytes) -> bool:
    """Whether a file begins as one of OUTPUT4 does."""
    if len(head) >= 28 and _order(head) is not None:
        return True
    return (
        bool(_TEXT_HEAD.fullmatch(head.split(b"\n", 1)[0].rstrip(b"\r")))
        and b"," in (head.split(b"\n", 1)[0])
    )


def read_op4(path: Path, name: str | None) -> Matrix:
    """Read one matrix; `name` chooses among several."""
    content = path.read_bytes()
    order = _order(content)
    found = dict(_binary(content, order) if order else _texts(content))
    if name is None and len(found) > 1:
        raise DataError(f"{path} has the matrices {', '.join(found)}; say which by name")
    name = next(iter(found)) if name is None else name
    if name.upper() not in found:
        raise DataError(f"{path} has no matrix '{name}': {nearest(name, found)}")
    A, precision = found[name.upper()]
    return Matrix(A, (), precision, name)


def _order(content: bytes) -> str | None:
    """Byte order of a binary file: its first record has 24 bytes."""
    return next((o for o in "<>" if content[:4] == struct.pack(f"{o}i", 24)), None)


def _binary(
    content: bytes, order: str
) -> Iterator[tuple[str, tuple[scipy.sparse.csc_array, float]]]:
    at = 0

    def record() -> bytes:
        nonlocal at
        (size,) = struct.unpack_from(f"{order}i", content, at)
        data = content[at + 4 : at + 4 + size]
        if len(data) < size:
            raise DataError("the file ends within a matrix")
        at += size + 8
        return data

    while at < len(content):
        head = _head(*struct.unpack(f"{order}4i8s", record()[:24]))
        words = 1 if head.kind == 1 else 2
        strings: dict[int, list[Column]] = {}
        while (column := struct.unpack(f"{order}3i", (data := record())[:12]))[0] <= head.columns:
            number, first, _ = column
            body = data[12:]
            if first > 0:
                strings[number] = [(first - 1, np.frombuffer(body, f"{order}f{4 * words}"))]
            else:
                strings[number] = list(_sparse_strings(body, order, words, head.big))
        precision = float(np.finfo(np.float32).eps) / 2 if words == 1 else EPS
        yield head.name, (_together(head, strings), precision)


def _sparse_strings(body: bytes, order: str, words: int, big: bool) -> Iterator[Column]:
    at = 0
    while at < len(body):
        if big:
            length, row = struct.unpack_from(f"{order}2i", body, at)
            at += 8
        else:
            (packed,) = struct.unpack_from(f"{order}i", body, at)
            length, row = packed // _BIG_ROWS, packed % _BIG_ROWS
            at += 4
        size = 4 * (length - 1)
        yield row - 1, np.frombuffer(body[at : at + size], f"{order}f{4 * words}")
        at += size


def _texts(content: bytes) -> Iterator[tuple[str, tuple[scipy.sparse.csc_array, float]]]:
    lines = collections.deque(line for line in content.decode("latin-1").splitlines() if line)
    while lines:
        line = lines.popleft()
        found = _TEXT_HEAD.fullmatch(line.encode())
        if not found:
            raise DataError(f"'{line[:40]}' is no head of a matrix")
        head = _head(
            int(found[1]), int(found[2]), int(found[3]), int(found[4]), line[32:40].encode()
        )
        wide = re.search(r"\d*E(\d+)\.(\d+)", line)
        width, digits = (int(wide[1]), int(wide[2]) + 1) if wide else (16, 9)
        strings: dict[int, list[Column]] = {}
        while (column := [int(c) for c in lines.popleft().split()])[0] <= head.columns:
            number, first, _ = column
            if first > 0:
                strings[number] = [(first - 1, _numbers(lines, width))]
                continue
            strings[number] = []
            while len(cells := [int(cell) for cell in lines[0].split()]) < 3:
                lines.popleft()
                row = cells[1] if head.big else cells[0] % _BIG_ROWS
                strings[number].append((row - 1, _numbers(lines, width)))
        _numbers(lines, width)  # one that closes the last column
        yield head.name, (_together(head, strings), max(EPS, 0.5 * 10.0 ** (1 - digits)))


def _numbers(lines: collections.deque[str], width: int) -> np.ndarray:
    """All numbers up to a line of whole ones: programs differ in how they count them."""
    found: list[float] = []
    while lines and "." in lines[0] and not _TEXT_HEAD.fullmatch(lines[0].encode()):
        line = lines.popleft().rstrip().replace("D", "E")
        found += [float(line[i : i + width]) for i in range(0, len(line), width)]
    return np.array(found)


def _head(columns: int, rows: int, form: int, kind: int, name: bytes) -> _Head:
    del form
    if kind > 2:
        raise DataError("it is a complex matrix")
    text = name.decode("latin-1").strip().upper()
    return _Head(columns, abs(rows), kind, text, rows < 0 or rows >= _BIG_ROWS)


def _together(head: _Head, strings: dict[int, list[Column]]) -> scipy.sparse.csc_array:
    values, rows, columns = [], [], []
    for number, parts in strings.items():
        for first, part in parts:
            values.append(part)
            rows.append(first + np.arange(part.size))
            columns.append(np.full(part.size, number - 1))
    entries = (
        np.concatenate(values or [[]]).astype(float),
        (
            np.concatenate(rows or [[]]).astype(int),
            np.concatenate(columns or [[]]).astype(int),
        ),
    )
    return scipy.sparse.csc_array(entries, shape=(head.rows, head.columns))
