"""Tables of data frames and spreadsheets: Parquet, Feather, XLSX."""

import contextlib
import dataclasses
import itertools
import json
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from backsight.data._kinds import begins_with
from backsight.data._pick import no_column
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats.libraries import library
from backsight.data.texts.reading import list_content, read_content
from backsight.data.times.clock import seconds
from backsight.errors import DataError

TOP, FEWEST = 200, 3
"""Rows of a sheet that are looked at, and rows with numbers that make it a table."""


def frames_in(folder: Path) -> list[Path]:
    """Parquet files of a folder that follow each other; such as are being written begin with a dot.

    Another process may add parts meanwhile, and remove the oldest.
    """
    return sorted(p for p in folder.glob("*.parquet") if not p.name.startswith("."))


def read_parquet(path: Path, request: Request) -> Contents:
    """Read columns of a Parquet file, or of a folder of them; dates stay dates."""
    library("pyarrow")
    if path.is_dir():
        parts = [_parquet_of(part, request) for part in frames_in(path)]
        return _columns(library("pyarrow").concat_tables(parts), request)
    return _columns(_parquet_of(path, request), request)


def _parquet_of(path: Path, request: Request) -> Any:
    file = library("pyarrow.parquet").ParquetFile(path, memory_map=True)
    columns = _asked(file.schema_arrow, request)
    claimed = file.metadata.num_rows * 8 * len(columns)
    check_density(claimed, path.stat().st_size, "the table")
    check_room(claimed, "the table")
    return file.read(columns=columns)


def read_feather(path: Path, request: Request) -> Contents:
    """Read columns of a Feather file (Arrow IPC)."""
    arrow = library("pyarrow")
    with arrow.memory_map(str(path)) as source:
        reader = library("pyarrow.ipc").open_file(source)
        columns = _asked(reader.schema, request)
        check_room(path.stat().st_size, "the table")
        rows = 0
        for k in range(reader.num_record_batches):
            rows += reader.get_batch(k).num_rows
            check_room(rows * 8 * len(columns), "the table")
        return _columns(reader.read_all().select(columns), request)


def _asked(schema: Any, request: Request) -> list[str]:
    """Columns that are read: those that are wanted, and the frame's own time if none is."""
    absent = [no_column(name, schema.names) for name in request.wanted if name not in schema.names]
    if absent:
        raise DataError("; ".join(absent))
    index = None if request.clock else _index(schema)
    return list(dict.fromkeys([*request.wanted, *([index] if index else [])]))


def _columns(table: Any, request: Request) -> Contents:
    units = {}
    for field in table.schema:
        found = (field.metadata or {}).get(b"unit") or (field.metadata or {}).get(b"units")
        if found:
            units[field.name] = found.decode(errors="replace")
    columns = {name: _values(table[name], name, request) for name in request.wanted}
    index = None if request.clock else _index(table.schema)
    if index is None:
        return Contents(columns, units)
    time, begin = seconds(table[index].to_pandas().to_numpy(), time_format=None, where=index)
    return Contents(columns, units, time=time, begin=begin)


def _index(schema: Any) -> str | None:
    """Column that was the index of a data frame, if it holds dates or intervals."""
    told = json.loads((schema.metadata or {}).get(b"pandas", b"{}"))
    names = [name for name in told.get("index_columns", ()) if name in schema.names]
    if len(names) != 1:
        return None
    kind = str(schema.field(names[0]).type)
    return names[0] if kind.startswith(("timestamp", "duration")) else None


def _values(column: Any, name: str, request: Request) -> np.ndarray:
    if name == request.clock:
        return column.to_pandas().to_numpy()
    if str(column.type).startswith(("bool", "decimal")):
        column = column.cast("uint8" if str(column.type) == "bool" else "float64")
    values = column.to_pandas()
    if values.dtype.kind not in "fiub":
        raise DataError(f"'{name}' is not a column of real numbers, but of {column.type}")
    return values.to_numpy(float)


def list_frames(path: Path, _: Request) -> list[Listed]:
    """List the columns of a Parquet or Feather file."""
    arrow = library("pyarrow")
    path = frames_in(path)[-1] if path.is_dir() else path
    if begins_with(path, b"PAR1"):
        schema = library("pyarrow.parquet").read_schema(path)
    else:
        with arrow.memory_map(str(path)) as source:
            schema = library("pyarrow.ipc").open_file(source).schema
    return [Listed.of(f.name, _dtype(f.type)) for f in schema]


def _dtype(kind: Any) -> np.dtype | None:
    try:
        return np.dtype(kind.to_pandas_dtype())
    except (NotImplementedError, TypeError):
        # Dates with a time zone are no type of NumPy's.
        return np.dtype("M8[ns]") if str(kind).startswith("timestamp") else None


def read_xlsx(path: Path, request: Request) -> Contents:
    """Read columns of a spreadsheet, as of a text: names, units, preamble and footer are found.

    The first sheet with numbers is read, or that of ``sheet/column``. Values are those that were
    last computed; formulas are not run.
    """
    title, content, others = _sheet(path, request.wanted)
    bare = {name: name.removeprefix(f"{title}/") for name in request.wanted}
    text = dataclasses.replace(request.text, delimiter="\t")
    asked = dataclasses.replace(
        request,
        wanted=tuple(bare.values()),
        clock=bare.get(request.clock or ""),
        text=text,
    )
    try:
        found = read_content(content, asked)
    except DataError as error:
        if not others:
            raise
        hint = f"'{title}' is read; take another sheet as '{others[0]}/...'"
        raise DataError(f"{error}; the workbook has {1 + len(others)} sheets: {hint}") from None
    return Contents(
        {name: found.columns[own] for name, own in bare.items()},
        {name: found.units[own] for name, own in bare.items() if own in found.units},
        "; ".join(filter(None, (f"sheet '{title}'" if others else "", found.understood))),
    )


def list_xlsx(path: Path, request: Request) -> list[Listed]:
    """List the columns of the first sheet with numbers."""
    text = dataclasses.replace(request.text, delimiter="\t")
    return list_content(_sheet(path, ())[1], dataclasses.replace(request, text=text))


def _sheet(path: Path, wanted: Sequence[str]) -> tuple[str, bytes, list[str]]:
    """Title and cells of the sheet that is meant, as a text of tabs, and the other sheets."""
    openpyxl = library("openpyxl")
    with zipfile.ZipFile(path) as archive:
        claimed = sum(member.file_size for member in archive.infolist())
    check_density(claimed, path.stat().st_size, "the workbook")
    check_room(claimed, "the workbook")
    book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
    with contextlib.closing(book):
        titles = list(book.sheetnames)
        sheets = {name.rpartition("/")[0] for name in wanted} & set(titles)
        if len(sheets) > 1:
            raise DataError(f"the columns are on several sheets: {', '.join(sorted(sheets))}")
        tables = (name for name in titles if _has_numbers(book[name]))
        title = sheets.pop() if sheets else next(tables, titles[0])
        rows = [list(row) for row in book[title].iter_rows(values_only=True)]
    if any(None in row for row in rows):
        _check_computed(path, title, rows)
    content = "\n".join("\t".join(map(_cell, row)) for row in rows).encode()
    return title, content, [name for name in titles if name != title]


def _has_numbers(sheet: Any) -> bool:
    """Whether a sheet has rows of numbers near its top: it is no cover."""
    rows = itertools.islice(sheet.iter_rows(values_only=True), TOP)
    kinds = (int, float)
    counts = [any(isinstance(v, kinds) and not isinstance(v, bool) for v in row) for row in rows]
    return sum(counts) >= FEWEST


def _check_computed(path: Path, title: str, rows: Sequence[Sequence[Any]]) -> None:
    """Raise `DataError` if a blank cell is a formula whose value nobody computed."""
    book = library("openpyxl").load_workbook(path, read_only=True, keep_links=False)
    with contextlib.closing(book):
        for written, row in zip(book[title].iter_rows(), rows, strict=False):
            for cell, value in zip(written, row, strict=False):
                if value is None and cell.value is not None:
                    raise DataError(
                        f"cell {cell.coordinate} of '{title}' is a formula that was never "
                        "computed; open the workbook in a spreadsheet program and save it"
                    )


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if hasattr(value, "isoformat"):
        return value.isoformat()
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())
