"""Columns of a text file: CSV, TSV and what loggers and NumPy write."""

import csv
import dataclasses
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
import pandas as pd

from backsight.data._pick import no_column
from backsight.errors import DataError
from backsight.types import Array

DELIMITERS = ";\t,"
"""The first that is in the first two lines; without any, cells are separated by blanks."""

MISSING = ("", "nan", "NaN", "NAN", "NA")
"""Cells that mean "not measured"."""

INDENTED_COMMENT = re.compile(rb"[\r\n][ \t]+#")


@dataclasses.dataclass(frozen=True)
class Layout:
    """Layout of a text file: column names, delimiter (None: blanks), lines before the data."""

    names: tuple[str, ...]
    delimiter: str | None
    lines_before: int


def read_text(path: Path, wanted: Sequence[str], skip_lines: int) -> dict[str, Array]:
    """Read columns by name.

    The first line that is neither blank nor a comment (``#``) names the columns; if it begins
    with a number, the last comment before it does, as NumPy writes it; if that has another number
    of cells, the columns are called "0", "1", ... Cells are separated by semicolons, tabs, commas
    or blanks, numbers have a decimal point, and an empty cell is NaN.

    Parameters
    ----------
    path : Path
        The file.
    wanted : sequence of str
        Columns to read; the others may hold anything.
    skip_lines : int
        Lines at the top to pass over.

    Returns
    -------
    dict of (n,) arrays

    Raises
    ------
    DataError
        If a column is missing or not unique, or a cell is not a number (names line and column).
    """
    layout = _layout(path, skip_lines)
    absent = [no_column(name, layout.names) for name in wanted if name not in layout.names]
    if absent:
        raise DataError("; ".join(absent))
    for name in wanted:
        if layout.names.count(name) > 1:
            raise DataError(f"{layout.names.count(name)} columns are called '{name}'; rename them")
    positions = [layout.names.index(name) for name in wanted]
    try:
        table = _fast(path, layout, positions)
    except (ValueError, pd.errors.ParserWarning):
        # The fast parser also stumbles over harmless cells, and cannot say where.
        table = _careful(path, layout, positions)
    return dict(zip(wanted, table, strict=True))


def _layout(path: Path, skip_lines: int) -> Layout:
    lines = itertools.islice(_lines(path), skip_lines, None)
    comment, first, before = "", "", skip_lines
    for number, line in lines:
        if "\0" in line:
            raise DataError("this is not plain text in UTF-8; export it again as such")
        if _is_content(line):
            first, before = line, number - 1
            break
        comment = line.strip(" #") if line.strip() else comment
    second = next((line for _, line in lines if _is_content(line)), "")
    delimiter = next((d for d in DELIMITERS if d in first and d in (second or first)), None)
    cells = _cells(first, delimiter)
    if _is_header(cells):
        width = len(_trimmed(_cells(second, delimiter)))
        if width > len(cells):
            raise DataError(
                f"the line of names has {len(cells)} cells, the first line of numbers {width}"
            )
        return Layout(tuple(cells), delimiter, before + 1)
    names = _cells(comment, delimiter)
    if len(names) != len(cells):
        names = [str(k) for k in range(len(cells))]
    return Layout(tuple(names), delimiter, before)


def _fast(path: Path, layout: Layout, positions: list[int]) -> list[Array]:
    content = path.read_bytes()
    if INDENTED_COMMENT.search(content):
        raise ValueError("pandas takes a comment after blanks for a row of missing cells")
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # more cells than columns
        table = pd.read_csv(
            io.BytesIO(content),
            sep=layout.delimiter or r"\s+",
            header=None,
            names=list(range(len(layout.names))),
            index_col=False,
            dtype=dict.fromkeys(positions, float),
            skiprows=layout.lines_before,
            comment="#",
            skipinitialspace=True,
            keep_default_na=False,
            na_values=list(MISSING),
            low_memory=False,  # or long columns of text and numbers cause a warning
            encoding="utf-8-sig",
            encoding_errors="replace",
        )
    return [table[k].to_numpy(float) for k in positions]


def _careful(path: Path, layout: Layout, positions: list[int]) -> list[Array]:
    rows = []
    for number, line in itertools.islice(_lines(path), layout.lines_before, None):
        if not _is_content(line, layout.delimiter):
            continue
        cells = _trimmed(_cells(line.partition("#")[0], layout.delimiter))
        if len(cells) > len(layout.names):
            raise DataError(
                f"line {number} has {len(cells)} cells, but there are {len(layout.names)} columns"
            )
        cells += [""] * (len(layout.names) - len(cells))
        for k in sorted(positions):
            if not _is_number(cells[k]):
                _not_a_number(layout, number, layout.names[k], cells[k])
        rows.append([float(cells[k]) if cells[k] not in MISSING else np.nan for k in positions])
    return list(np.array(rows, float).reshape(len(rows), len(positions)).T)


def _not_a_number(layout: Layout, number: int, name: str, cell: str) -> NoReturn:
    hint = ""
    if _is_number(cell.replace(",", ".")):
        hint = "; numbers need a decimal point"
    elif number == layout.lines_before + 1:
        hint = "; if the line gives units, begin it with '#'"
    raise DataError(f"line {number}, column '{name}': '{cell}' is not a number{hint}")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    with path.open(encoding="utf-8-sig", errors="surrogateescape") as file:
        for number, line in enumerate(file, 1):
            yield number, _readable(line)


def _readable(line: str) -> str:
    """Take a line that is not UTF-8 as Latin-1: the µ and ° of older loggers."""
    try:
        line.encode()
    except UnicodeEncodeError:
        return line.encode("utf-8", "surrogateescape").decode("latin-1")
    return line


def _is_content(line: str, delimiter: str | None = None) -> bool:
    # In a table separated by tabs, a line of tabs is a row of missing cells.
    blanks = " \r\n" if delimiter == "\t" else None
    return bool(line.partition("#")[0].strip(blanks))


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return [cell.strip('"') for cell in line.split()]
    rows = csv.reader([line.strip("\r\n")], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip() for cell in next(rows, [])]


def _trimmed(cells: list[str]) -> list[str]:
    """Without the blank cell that a delimiter at the end of the line makes."""
    return cells[:-1] if cells and not cells[-1] else cells


def _is_header(cells: list[str]) -> bool:
    starts_with_number = bool(cells) and bool(cells[0]) and _is_number(cells[0])
    return not starts_with_number and not all(map(_is_number, cells))


def _is_number(cell: str) -> bool:
    if cell in MISSING:
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell
