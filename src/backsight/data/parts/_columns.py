"""Some rows of the columns of a large file."""

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np

from backsight.data.formats import check_links, datasets, library
from backsight.errors import DataError
from backsight.types import Array


class Rows(Protocol):
    """Columns of an open file."""

    count: int
    """Number of rows."""

    units: dict[str, str]
    """Units that the file says, by column."""

    def read(self, start: int, stop: int) -> dict[str, Array]:
        """Columns by name, (stop - start,) each."""
        ...


@contextlib.contextmanager
def opened(path: Path, wanted: Sequence[str]) -> Iterator[Rows]:
    """Open a file of columns.

    Raises
    ------
    DataError
        If it cannot be read in parts, or a column is missing, is not one of numbers, or is longer
        than another.
    """
    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            check_links(file, ())
            yield _Hdf5(file, wanted)
    elif path.suffix.lower() in (".parquet", ".pq"):
        yield _Parquet(path, wanted)
    else:
        raise DataError(
            f"{path} cannot be read in parts, which goes with HDF5, NetCDF 4 and Parquet; a long "
            "text is cut into files, which are then given as a folder or a list"
        )


class _Hdf5:
    def __init__(self, file: h5py.File, wanted: Sequence[str]) -> None:
        found = datasets(file, wanted, (), whole=False)
        for name in wanted:
            if name not in found:
                raise DataError(f"there is no column '{name}' in the file")
            if found[name].ndim != 1:
                raise DataError(
                    f"'{name}' has the shape {found[name].shape}; columns that are read in parts "
                    "have one axis"
                )
        self._columns = {name: found[name] for name in wanted}
        self.count = _same_length({name: len(c) for name, c in self._columns.items()})
        self.units = {name: _unit(c) for name, c in self._columns.items()}

    def read(self, start: int, stop: int) -> dict[str, Array]:
        """See `Rows`."""
        return {n: np.asarray(c[start:stop], float) for n, c in self._columns.items()}


class _Parquet:
    def __init__(self, path: Path, wanted: Sequence[str]) -> None:
        self._file = library("pyarrow.parquet").ParquetFile(path, memory_map=True)
        self._wanted = list(wanted)
        schema = self._file.schema_arrow
        for name in wanted:
            if name not in schema.names:
                raise DataError(f"there is no column '{name}' in the file")
        about = self._file.metadata
        groups = [about.row_group(k).num_rows for k in range(about.num_row_groups)]
        self._ends = list(itertools.accumulate(groups))
        self.count = about.num_rows
        found = {name: schema.field(name).metadata or {} for name in wanted}
        self.units = {
            name: (m.get(b"unit") or m.get(b"units") or b"").decode(errors="replace")
            for name, m in found.items()
        }

    def read(self, start: int, stop: int) -> dict[str, Array]:
        """See `Rows`; whole groups of rows are read, of which these are cut out."""
        groups = [
            k
            for k, end in enumerate(self._ends)
            if end > start and (self._ends[k - 1] if k else 0) < stop
        ]
        table = self._file.read_row_groups(groups, columns=self._wanted)
        first = self._ends[groups[0] - 1] if groups[0] else 0
        cut = table.slice(start - first, stop - start)
        return {n: np.asarray(cut[n].to_numpy(), float) for n in self._wanted}


def _same_length(lengths: dict[str, int]) -> int:
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"'{name}' {n}" for name, n in lengths.items())
        raise DataError(f"the numbers of samples differ: {listed}")
    return next(iter(lengths.values()))


def _unit(column: Any) -> str:
    found = column.attrs.get("units", column.attrs.get("unit", ""))
    return found.decode(errors="replace") if isinstance(found, bytes) else str(found)
