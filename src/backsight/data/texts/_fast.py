"""Columns of a text by the parsers of polars and pandas, where these take it as it is meant.

Both round correctly: the numbers are those of Python's ``float``.
"""

import importlib.util
import io
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from backsight.data.texts._cells import cells_of, lines
from backsight.data.texts._layout import Layout

_LOOK = 1 << 16
"""Bytes at the beginning of the numbers that tell how cells are written."""

_LONG = 1 << 20
"""Bytes from which on polars, on all cores, is worth its import."""


class Cells(NamedTuple):
    """Place of a column, and whether it holds float, int (ticks of a clock) or str (dates)."""

    place: int
    kind: type


def parsed_fast(
    content: bytes, layout: Layout, columns: Mapping[str, Cells]
) -> dict[str, np.ndarray] | None:
    """Columns by name, or None if a fast parser would not see what the careful one does."""
    if layout.numbers.thousands is not None:
        return None  # pandas takes signs of thousands anywhere
    numeric = all(c.kind is not str for c in columns.values())
    long = numeric and layout.delimiter is not None and layout.stop - layout.start > _LONG
    # Polars takes quotes and comments as they stand: it stumbles over those in cells that it reads.
    if long and len(columns) == len(layout.names):
        if (table := _by_polars(content, layout, columns)) is not None:
            return table
        long = False
    for sign in {'"', "#", layout.comment, "\0"}:
        if content.find(sign.encode(), layout.start) >= 0:
            return None  # quotes and comments would swallow what follows
    if long and (table := _by_polars(content, layout, columns)) is not None:
        return table
    if any(c.kind is float and _is_word(content, layout, c.place) for c in columns.values()):
        return None  # pandas takes True and False for numbers
    try:
        return _by_pandas(content, layout, columns)
    except (ValueError, OverflowError, pd.errors.ParserWarning):
        return None


def _by_polars(
    content: bytes, layout: Layout, columns: Mapping[str, Cells]
) -> dict[str, np.ndarray] | None:
    if importlib.util.find_spec("polars") is None:
        return None
    # Words for missing ones triple the time: they are looked for only if a cell is no number.
    plain = _polars_table(content, layout, columns, missing=())
    if plain is not None:
        return plain
    return _polars_table(content, layout, columns, missing=layout.numbers.missing)


def _polars_table(
    content: bytes, layout: Layout, columns: Mapping[str, Cells], *, missing: Sequence[str]
) -> dict[str, np.ndarray] | None:
    import polars

    comma = layout.numbers.decimal == ","
    if comma and content.find(b".", layout.start, layout.stop) >= 0:
        return None  # a point is taken for a decimal sign as well
    numbers = {float: polars.Float64, int: polars.Int64}
    kinds: dict[int, Any] = {cells.place: numbers[cells.kind] for cells in columns.values()}
    kinds.setdefault(len(layout.names) - 1, polars.String)  # or longer lines would not be seen
    whole = layout.stop == len(content)
    try:
        table = polars.read_csv(
            content if whole else content[layout.start : layout.stop],
            has_header=False,
            skip_lines=layout.first_line - 1 if whole else 0,
            schema={str(k): kinds.get(k, polars.String) for k in range(len(layout.names))},
            columns=sorted(kinds),
            separator=layout.delimiter or ",",
            quote_char=None,
            null_values=list(missing),
            decimal_comma=comma,
        )
    except polars.exceptions.PolarsError:
        return None  # also if lines are longer than others
    if min(table.null_count().row(0)) > 0:
        blank = table.select(polars.all_horizontal(polars.all().is_null()).any())
        if blank.item():
            return None  # a blank line is no row
    found = {name: table[str(cells.place)] for name, cells in columns.items()}
    if any(values.dtype == polars.Int64 and values.null_count() for values in found.values()):
        return None
    return {name: values.to_numpy() for name, values in found.items()}


def _by_pandas(
    content: bytes, layout: Layout, columns: Mapping[str, Cells]
) -> dict[str, np.ndarray]:
    if layout.stop == len(content):
        file = io.BytesIO(content)  # shares the bytes
        file.seek(layout.start)
    else:
        file = io.BytesIO(content[layout.start : layout.stop])
    dtypes: dict[Any, Any] = {
        cells.place: np.int64 if cells.kind is int else cells.kind for cells in columns.values()
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # more cells than columns
        table = pd.read_csv(
            file,
            sep=layout.delimiter or r"\s+",
            header=None,
            names=list(range(len(layout.names))),
            index_col=False,
            dtype=dtypes,
            decimal=layout.numbers.decimal,
            # Blanks before numbers do not matter, those before words do; looking costs time.
            skipinitialspace=b" " in content[layout.start : layout.start + _LOOK],
            keep_default_na=False,
            na_values=list(layout.numbers.missing),
            low_memory=False,  # or long columns of text and numbers cause a warning
            encoding_errors="replace",
        )
    if layout.delimiter is None and table.iloc[:, -1].isna().any():
        raise ValueError("between blanks, a cell that is missing moves the others")
    return {
        name: table[cells.place].fillna("").to_numpy(object)
        if cells.kind is str
        else table[cells.place].to_numpy()
        for name, cells in columns.items()
    }


def _is_word(content: bytes, layout: Layout, place: int) -> bool:
    """Whether the first cell of a column is no number; pandas takes a column of words at once."""
    first = next(lines(content, start=layout.start, stop=layout.stop), None)
    cells = cells_of(first.text, layout.delimiter) if first else []
    return place < len(cells) and layout.numbers.value(cells[place]) is None
