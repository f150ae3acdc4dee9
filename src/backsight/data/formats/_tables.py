"""Tables of data frames and spreadsheets: Parquet, Feather, XLSX."""

import dataclasses
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
from backsight.errors import DataError


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
    names = file.schema_arrow.names
    _check(names, request.wanted)
    claimed = file.metadata.num_rows * 8 * len(request.wanted)
    check_density(claimed, path.stat().st_size, "the table")
    check_room(claimed, "the table")
    return file.read(columns=list(request.wanted))


def read_feather(path: Path, request: Request) -> Contents:
    """Read columns of a Feather file (Arrow IPC)."""
    arrow = library("pyarrow")
    with arrow.memory_map(str(path)) as source:
        reader = library("pyarrow.ipc").open_file(source)
        _check(reader.schema.names, request.wanted)
        check_room(path.stat().st_size, "the table")
        rows = 0
        for k in range(reader.num_record_batches):
            rows += reader.get_batch(k).num_rows
            check_room(rows * 8 * len(request.wanted), "the table")
        return _columns(reader.read_all().select(list(request.wanted)), request)


def _check(names: Sequence[str], wanted: Sequence[str]) -> None:
    absent = [no_column(name, names) for name in wanted if name not in names]
    if absent:
        raise DataError("; ".join(absent))


def _columns(table: Any, request: Request) -> Contents:
    units = {}
    for field in table.schema:
        found = (field.metadata or {}).get(b"unit") or (field.metadata or {}).get(b"units")
        if found:
            units[field.name] = found.decode(errors="replace")
    columns = {name: _values(table[name], name, request) for name in request.wanted}
    return Contents(columns, units)


def _values(column: Any, name: str, request: Request) -> np.ndarray:
    values = column.to_pandas()
    if name == request.clock:
        return values.to_numpy()
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

    The first sheet is read, or that of ``sheet/column``. Values are those that were last computed;
    formulas are not run.
    """
    title, content = _sheet(path, request.wanted)
    bare = {name: name.removeprefix(f"{title}/") for name in request.wanted}
    text = dataclasses.replace(request.text, delimiter="\t", decimal=".")
    asked = dataclasses.replace(
        request,
        wanted=tuple(bare.values()),
        clock=bare.get(request.clock or ""),
        text=text,
    )
    found = read_content(content, asked)
    return Contents(
        {name: found.columns[own] for name, own in bare.items()},
        {name: found.units[own] for name, own in bare.items() if own in found.units},
        found.understood,
    )


def list_xlsx(path: Path, request: Request) -> list[Listed]:
    """List the columns of the first sheet."""
    text = dataclasses.replace(request.text, delimiter="\t", decimal=".")
    return list_content(_sheet(path, ())[1], dataclasses.replace(request, text=text))


def _sheet(path: Path, wanted: Sequence[str]) -> tuple[str, bytes]:
    """Title and cells of the sheet that is meant, as a text of tabs."""
    openpyxl = library("openpyxl")
    with zipfile.ZipFile(path) as archive:
        claimed = sum(member.file_size for member in archive.infolist())
    check_density(claimed, path.stat().st_size, "the workbook")
    check_room(claimed, "the workbook")
    book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
    try:
        sheets = {name.rpartition("/")[0] for name in wanted} & set(book.sheetnames)
        if len(sheets) > 1:
            raise DataError(f"the columns are on several sheets: {', '.join(sorted(sheets))}")
        title = sheets.pop() if sheets else book.sheetnames[0]
        rows = book[title].iter_rows(values_only=True)
        return title, "\n".join("\t".join(map(_cell, row)) for row in rows).encode()
    finally:
        book.close()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if hasattr(value, "isoformat"):
        return value.isoformat()
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())
