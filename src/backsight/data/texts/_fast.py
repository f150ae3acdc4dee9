"""Columns of a text by the parsers of Arrow and pandas, where these take it as it is meant.

Both round correctly: the numbers are those of Python's ``float``.
"""

import importlib.util
import io
import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from backsight.data.texts._cells import cells_of, lines
from backsight.data.texts._layout import Layout

_LOOK = 1 << 16
"""Bytes at the beginning of the numbers that tell how cells are written."""

_LONG = 1 << 20
"""Bytes from which on Arrow, on all cores, is worth its import."""

_BLOCK = 1 << 20
"""Bytes that Arrow gives a core at a time: they stay in its cache."""


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
    arrow = numeric and layout.delimiter is not None and layout.stop - layout.start > _LONG
    # Arrow takes quotes and comments as they stand: it stumbles over those in cells that it reads.
    if arrow and len(columns) == len(layout.names):
        if (table := _by_arrow(content, layout, columns)) is not None:
            return table
        arrow = False
    for sign in {'"', "#", layout.comment, "\0"}:
        if content.find(sign.encode(), layout.start) >= 0:
            return None  # quotes and comments would swallow what follows
    if arrow and (table := _by_arrow(content, layout, columns)) is not None:
        return table
    if any(c.kind is float and _is_word(content, layout, c.place) for c in columns.values()):
        return None  # pandas takes True and False for numbers
    try:
        return _by_pandas(content, layout, columns)
    except (ValueError, OverflowError, pd.errors.ParserWarning):
        return None


def _by_arrow(
    content: bytes, layout: Layout, columns: Mapping[str, Cells]
) -> dict[str, np.ndarray] | None:
    if importlib.util.find_spec("pyarrow") is None:
        return None
    import pyarrow as arrow
    import pyarrow.csv as texts

    numbers = {float: arrow.float64(), int: arrow.int64()}
    places = {str(cells.place): numbers[cells.kind] for cells in columns.values()}
    try:
        table = texts.read_csv(
            arrow.py_buffer(content)[layout.start : layout.stop],  # shares the bytes
            read_options=texts.ReadOptions(
                column_names=[str(k) for k in range(len(layout.names))], block_size=_BLOCK
            ),
            parse_options=texts.ParseOptions(
                delimiter=layout.delimiter, quote_char=False, double_quote=False
            ),
            convert_options=texts.ConvertOptions(
                column_types=places,
                include_columns=list(places),
                null_values=list(layout.numbers.missing),
                decimal_point=layout.numbers.decimal,
                check_utf8=False,
            ),
        )
    except (arrow.ArrowInvalid, arrow.ArrowNotImplementedError):
        return None  # also if lines are of several lengths
    if any(table[str(c.place)].null_count for c in columns.values() if c.kind is int):
        return None
    return {name: table[str(cells.place)].to_numpy() for name, cells in columns.items()}


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
