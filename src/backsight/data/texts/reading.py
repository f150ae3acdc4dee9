"""Columns of a text file: CSV, TSV and what loggers and NumPy write."""

from pathlib import Path
from typing import NoReturn

import numpy as np

from backsight.data._pick import no_column
from backsight.data._request import Contents, Listed, Request
from backsight.data.texts._cells import cells_of, is_blank, lines, trimmed
from backsight.data.texts._fast import Cells, parsed_fast
from backsight.data.texts._layout import Layout, layout_of
from backsight.data.texts._units import split
from backsight.data.texts.content import content_of
from backsight.data.times.clock import NUMERIC
from backsight.data.times.dates import is_compact, is_date
from backsight.errors import DataError

_EXACT = 16
"""Digits of whole numbers that are kept as such."""


def read_text(path: Path, request: Request) -> Contents:
    """Read columns by name.

    The line above the first line of numbers names the columns, or the one above that if it gives
    units; if there is none, the last comment (``#``) before it does, as NumPy writes it; if that
    has another number of cells, the columns are called "0", "1", ... Cells are separated by
    semicolons, tabs, bars, commas or blanks, numbers have a decimal point or comma, and an empty
    cell is NaN. A clock ``Date + Time`` is a date and a time of the day in two columns.

    Parameters
    ----------
    path : Path
        The file, perhaps packed.
    request : Request
        Columns to read, the others may hold anything; and what the caller knows of the text.

    Raises
    ------
    DataError
        If a column is missing or not unique, a cell is not a number (names line and column), or
        the text could be understood in two ways.
    """
    return read_content(content_of(path, request.text.encoding), request)


def read_content(content: bytes, request: Request) -> Contents:
    r"""Read columns of a text, given in UTF-8 with ``\n``; see `read_text`."""
    layout = layout_of(content, request.text, request.wanted)
    clock = request.clock or ""
    halves = _halves(layout, clock)
    whole = [n for n in request.wanted if not halves or n != clock]
    wanted = tuple(dict.fromkeys([*whole, *halves]))
    absent = [no_column(n, layout.names) for n in wanted if layout.position(n) is None]
    if absent:
        raise DataError("; ".join(absent))
    for name in wanted:
        if layout.names.count(name) > 1:
            raise DataError(f"{layout.names.count(name)} columns are called '{name}'; rename them")
    kinds = {n: str if n in halves else _kind(content, layout, request, n) for n in wanted}
    columns = {name: Cells(_place(layout, name), kind) for name, kind in kinds.items()}
    table = parsed_fast(content, layout, columns)
    if table is None:
        # A fast parser also stumbles over harmless cells, and cannot say where.
        table = _careful(content, layout, kinds, request.clock)
    units = {name: layout.units[_place(layout, name)] for name in wanted if name not in halves}
    if halves:
        day, hour = (table.pop(name) for name in halves)
        pairs = zip(day, hour, strict=True)
        joined = [f"{str(d).partition('T')[0].strip()} {str(h).strip()}".strip() for d, h in pairs]
        table[clock] = np.array(joined, object)
    return Contents(table, {n: unit for n, unit in units.items() if unit}, layout.understood)


def _halves(layout: Layout, clock: str) -> list[str]:
    """Columns of a clock ``Date + Time``: the date and the time of the day; none of another."""
    if not clock or layout.position(clock) is not None:
        return []
    found = [part.strip() for part in clock.split(" + ")]
    return found if len(found) == 2 and all(layout.position(n) is not None for n in found) else []


def list_text(path: Path, request: Request) -> list[Listed]:
    """List the columns; see `read_text`."""
    return list_content(content_of(path, request.text.encoding), request)


def list_content(content: bytes, request: Request) -> list[Listed]:
    """List the columns of a text, given as to `read_content`."""
    layout = layout_of(content, request.text, ())
    bare = [split(name)[0] for name in layout.names]
    found = []
    for name in dict.fromkeys(filter(None, layout.names)):
        place, count = layout.names.index(name), layout.names.count(name)
        own = bare[place] if bare.count(bare[place]) == 1 else name
        if count > 1:
            found.append(Listed(name, "other", f"{count} columns are called so"))
        elif place not in layout.numeric:
            found.append(Listed(own, "other", "text"))
        else:
            dates = _kind_by_cells(content, layout, place) is str
            found.append(Listed(own, "dates" if dates else "numbers"))
    return found


def _place(layout: Layout, name: str) -> int:
    place = layout.position(name)
    if place is None:
        raise DataError(no_column(name, layout.names))
    return place


def _kind(content: bytes, layout: Layout, request: Request, name: str) -> type:
    """Of the cells of a column: numbers, whole numbers (ticks of a clock), or text (dates)."""
    if name != request.clock:
        return float
    if request.time_format in NUMERIC:
        return int if request.time_format not in ("excel", "matlab") else float
    if request.time_format is not None:
        return str
    return _kind_by_cells(content, layout, _place(layout, name))


def _kind_by_cells(content: bytes, layout: Layout, place: int) -> type:
    for line in lines(content, start=layout.start, stop=layout.stop):
        cells = cells_of(line.text, layout.delimiter)
        if is_blank(line.text) or len(cells) <= place or not cells[place]:
            continue
        if cells[place] in layout.numbers.missing:
            continue
        if is_compact(cells[place]):
            return str
        number = layout.numbers.value(cells[place]) is not None
        if number and cells[place].isdecimal() and len(cells[place]) >= _EXACT:
            return int  # ticks of a clock that no float tells apart
        return float if number or not is_date(cells[place]) else str
    return float


def _careful(
    content: bytes, layout: Layout, kinds: dict[str, type], clock: str | None
) -> dict[str, np.ndarray]:
    places = {name: _place(layout, name) for name in kinds}
    found: dict[str, list[object]] = {name: [] for name in kinds}
    width = len(layout.names)
    begin = {"start": layout.start, "number": layout.first_line}
    for line in lines(content, **begin, stop=layout.stop):
        text = line.text
        if is_blank(text, layout.delimiter) or text.lstrip().startswith(("#", layout.comment)):
            continue
        cells = _without_comment(text, layout, width)
        if len(cells) > width:
            raise DataError(
                f"line {line.number} has {len(cells)} cells, but there are {width} columns"
            )
        if layout.delimiter is None and len(cells) < width:
            raise DataError(
                f"line {line.number} has {len(cells)} cells, but there are {width} columns; "
                "between blanks it is not plain which are missing, write nan"
            )
        cells += [""] * (width - len(cells))
        for name, place in sorted(places.items(), key=lambda item: item[1]):
            cell = cells[place]
            if kinds[name] is str:
                found[name].append(cell)
                continue
            if kinds[name] is int and cell.lstrip("+-").isdecimal():
                found[name].append(int(cell))
                continue
            value = layout.numbers.value(cell)
            if value is None:
                _not_a_number(layout, line.number, name, cell, clock)
            found[name].append(value)
    return {
        name: np.array(values, object if kinds[name] is str else None if values else float)
        for name, values in found.items()
    }


def _without_comment(text: str, layout: Layout, width: int) -> list[str]:
    """Cells of a line; a comment ends it only where it follows all cells that it may have.

    The sign may also be in a cell of text: ``run #1``.
    """
    cells = trimmed(cells_of(text, layout.delimiter))
    before, sign, after = text.partition("#")
    if sign and (layout.delimiter is None or layout.delimiter not in after or len(cells) > width):
        short = trimmed(cells_of(before, layout.delimiter))
        last = cells[len(short) - 1] if 0 < len(short) <= len(cells) else ""
        if before[-1:].isspace() or layout.numbers.value(last) is None or len(cells) > width:
            numeric = short and layout.numbers.value(short[-1]) is not None
            return short if numeric or len(cells) > width else cells
    return cells


def _not_a_number(layout: Layout, number: int, name: str, cell: str, clock: str | None) -> NoReturn:
    hint, first = "", number == layout.first_line
    if layout.numbers.decimal == "." and layout.numbers.value(cell.replace(",", ".")) is not None:
        hint = '; numbers need a decimal point, or say decimal = ","'
    elif name == clock and sum(map(str.isdigit, cell)) > len(cell) // 3:
        hint = ", nor a date that is known; give time_format, as in '%d.%m.%Y %H:%M:%S.%f'"
    elif first:
        hint = "; if the line gives units, begin it with '#'"
    elif name != clock and not cell.islower() and not any(map(str.isdigit, cell)):
        # Words for that are codes or signs: OL, -, N.A.
        hint = f'; if that means "not measured", say missing = ["{cell}"]'
    raise DataError(f"line {number}, column '{name}': '{cell[:60]}' is not a number{hint}")
