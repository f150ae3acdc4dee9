"""Matrices in plain texts: Abaqus, dumps of OpenSees, tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import scipy

from backsight.data.finite_elements.matrix import Matrix, of_places, precision_of
from backsight.errors import DataError

ABAQUS = re.compile(r"\s*\d+\s*,\s*\d+\s*,\s*\d+\s*,\s*\d+\s*,\s*[-+.\d]")
"""A line of a matrix in the format of *MATRIX INPUT: node, direction, node, direction, value."""

_COMMENT = ("#", "%", "$", "**", "//")


def read_abaqus(path: Path) -> Matrix:
    """Read a matrix that ``*MATRIX GENERATE`` wrote; one triangle stands for both.

    Source: Abaqus Analysis User's Guide, "Generating structural matrices".
    """
    rows, columns, values, written = [], [], [], []
    for number, line in enumerate(_lines(path), 1):
        cells = line.split(",")
        try:
            i, a, j, b = (int(cell) for cell in cells[:4])
            value = float(cells[4].upper().replace("D", "E"))
        except (ValueError, IndexError):
            raise DataError(
                f"{path}, entry {number}: '{line}' is not node, direction, node, direction, value"
            ) from None
        rows.append((i, a))
        columns.append((j, b))
        values.append(value)
        written.append(cells[4])
    precision = precision_of(written)
    one_sided = all(r <= c for r, c in zip(rows, columns, strict=True)) or all(
        r >= c for r, c in zip(rows, columns, strict=True)
    )
    return of_places(rows, columns, values, precision=precision, name=path.stem, mirrored=one_sided)


def read_table(path: Path) -> Matrix:
    """Read rows of numbers, or of ``row column value`` counted from 1.

    A line of names above the numbers, with commas, semicolons, tabs or blanks, names coordinates.
    """
    lines = _lines(path)
    if not lines:
        raise DataError(f"{path} is empty")
    cells = [_cells(line) for line in lines]
    names: tuple[str, ...] = ()
    if not _is_number(cells[0][-1]):
        names, cells = tuple(cells[0]), cells[1:]
    if not cells or len({len(row) for row in cells}) != 1:
        widths = sorted({len(row) for row in cells})
        raise DataError(f"{path}: the rows have different lengths: {widths}")
    if names and len(cells[0]) == len(names) and not _is_number(cells[0][0]):
        names, cells = names[1:], [row[1:] for row in cells]
    try:
        values = np.array(cells, float)
    except ValueError:
        bad = next(cell for row in cells for cell in row if not _is_number(cell))
        raise DataError(f"{path}: '{bad}' is not a number") from None
    precision = precision_of(cell for row in cells[:2000] for cell in row)
    if _is_triplets(values):
        values, written = _from_triplets(values), [row[2] for row in cells]
        precision = precision_of(written)
    return Matrix(scipy.sparse.csc_array(values), names, precision, path.stem)


def _lines(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith(_COMMENT)]


def _cells(line: str) -> list[str]:
    for sign in (";", "\t", ","):
        if sign in line:
            return [cell.strip().strip('"') for cell in line.strip(sign).split(sign)]
    return line.split()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _is_triplets(values: np.ndarray) -> bool:
    """Three columns, of which the first two count: no square matrix of three rows."""
    if values.shape[1] != 3 or values.shape[0] == 3:
        return False
    index = values[:, :2]
    return bool((index == np.rint(index)).all() and index.min() >= 1)


def _from_triplets(values: np.ndarray) -> scipy.sparse.csc_array:
    n = int(values[:, :2].max())
    # A Matrix Market file without its banner begins with rows, columns, and entries that follow.
    if len(values) > 1 and (values[0] == (n, n, len(values) - 1)).all():
        values = values[1:]
    rows, columns = (values[:, k].astype(int) - 1 for k in (0, 1))
    return scipy.sparse.csc_array((values[:, 2], (rows, columns)), shape=(n, n))
