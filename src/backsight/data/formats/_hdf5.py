"""Datasets of an HDF5 file, looked at before they are read.

HDF5 can store a dataset in other files: any file of the computer, whose bytes then are its values
(external storage); files that are linked or put together (external links, virtual datasets). And
filters are programs that the library loads when it reads. A recording from elsewhere must
not bring the one or run the other.
"""

import math
import os
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from backsight.data._pick import INDEXED
from backsight.data._room import check_density, check_room
from backsight.errors import DataError

if TYPE_CHECKING:
    import h5py

FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32", 4: "szip", 5: "nbit", 6: "scaleoffset"} | {
    32000: "lzf"
}
"""Those that the libraries bring along, by their registered numbers."""


def datasets(
    file: "h5py.File", wanted: Sequence[str], outside: Collection[str], *, whole: bool = True
) -> dict[str, Any]:
    """Return all datasets by name, without MATLAB's own; those that are wanted are safe to read.

    Parameters
    ----------
    file : h5py.File
    wanted : sequence of str
        Names, also as ``name[2]``.
    outside : collection of str
        Other files, as the file calls them, from which it may take measurements.
    whole : bool
        They will be read whole, so that they must fit into memory.

    Raises
    ------
    DataError
        If one that is wanted is in another file, needs a foreign filter, holds no numbers, or does
        not fit into memory.
    """
    import h5py

    found = _found(file)
    for name in wanted_names(wanted, found):
        if isinstance(found.get(name), Field):
            continue
        table, _, field = name.rpartition("/")
        if name not in found and table in found and field in (found[table].dtype.names or ()):
            check_dataset(found[table], table, outside, field=field, whole=whole)
            found[name] = Field(found[table], field)
            continue
        if name not in found:
            entry = _linked(file, name, outside)
            if not isinstance(entry, h5py.Dataset):
                continue
            found[name] = entry
        check_dataset(found[name], name, outside, whole=whole)
    return found


def leaves(file: "h5py.File") -> dict[str, Any]:
    """All datasets, and the columns of tables, by name; none is read."""
    columns: dict[str, Any] = {}
    for name, entry in _found(file).items():
        fields = entry.dtype.names or ()
        columns |= {f"{name}/{field}": Field(entry, field) for field in fields} or {name: entry}
    return columns


def _found(file: "h5py.File") -> dict[str, Any]:
    import h5py

    found: dict[str, Any] = {}

    def collect(name: str, entry: Any) -> None:
        if isinstance(entry, h5py.Dataset) and not name.startswith("#"):  # MATLAB's "#refs#"
            found[name] = entry

    file.visititems(collect)  # follows no links
    return found


def wanted_names(wanted: Sequence[str], found: Collection[str]) -> Iterator[str]:
    """Names of the arrays that are meant: ``acc`` by ``acc[2]`` unless there is an ``acc[2]``."""
    for reference in wanted:
        indexed = INDEXED.fullmatch(reference)
        yield indexed["name"] if indexed and reference not in found else reference


def check_links(file: "h5py.File", outside: Collection[str]) -> None:
    """Raise `DataError` if anything in the file is a link to another one, for readers that follow.

    Opening is harm enough: a link may lead to a device that never ends.
    """
    import h5py

    for name, link in _links(file).items():
        if isinstance(link, h5py.ExternalLink):
            _refuse(name, "is a link to", {link.filename} - set(outside))


def _links(file: "h5py.File") -> dict[str, Any]:
    """Every link in the file by its path; none is followed."""
    links: dict[str, Any] = {}
    file.visititems_links(lambda name, link: links.update({name: link}))
    return links


class Field:
    """A column of a table (a dataset of compound type), read when it is made an array."""

    def __init__(self, table: "h5py.Dataset", name: str) -> None:
        self.table, self.name = table, name
        own = table.dtype[name]
        self.shape = (*table.shape, *own.shape)
        self.dtype = own.base

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Read it."""
        return np.array(self.table.fields(self.name)[()], dtype=dtype, copy=copy)


def check_dataset(
    entry: "h5py.Dataset",
    name: str,
    outside: Collection[str],
    *,
    field: str | None = None,
    whole: bool = True,
) -> None:
    """Raise `DataError` unless a dataset can be read without harm and holds numbers.

    Of a table, `field` is the column that is wanted. If it is not read as a `whole`, it need not
    fit into memory.
    """
    elsewhere = _check_source(entry, name, outside)
    if entry.shape is None:
        raise DataError(f"'{name}' is empty")
    dtype = entry.dtype if field is None else entry.dtype[field].base
    if dtype.names:
        raise DataError(
            f"'{name}' is not an array of real numbers, but a table: take a column as "
            f"'{name}/{dtype.names[0]}'"
        )
    if dtype.kind not in "fiub":
        raise DataError(f"'{name}' is not an array of real numbers, but of {dtype}")
    claimed = math.prod(entry.shape) * max(entry.dtype.itemsize, np.dtype(float).itemsize)
    if not elsewhere:
        check_density(claimed, entry.id.get_storage_size(), f"'{name}'")
    if whole:
        check_room(claimed, f"'{name}'")


def check_sources(file: "h5py.File", outside: Collection[str]) -> None:
    """Raise `DataError` if anything in the file comes from elsewhere, for readers that read all."""
    import h5py

    check_links(file, outside)

    def check(name: str, entry: Any) -> None:
        if isinstance(entry, h5py.Dataset):
            _check_source(entry, name, outside)

    file.visititems(check)


def _check_source(entry: "h5py.Dataset", name: str, outside: Collection[str]) -> set[str]:
    """Raise `DataError` if a dataset needs other files or programs; which files are allowed."""
    import h5py

    plan = entry.id.get_create_plist()
    elsewhere = {os.fsdecode(plan.get_external(k)[0]) for k in range(plan.get_external_count())}
    _refuse(name, "is stored in", elsewhere - set(outside))
    if plan.get_layout() == h5py.h5d.VIRTUAL:
        sources = {source.file_name for source in entry.virtual_sources()}
        _refuse(name, "is put together of", sources - set(outside))
        elsewhere |= sources
    for k in range(plan.get_nfilters()):
        number, *_, title = plan.get_filter(k)
        if number not in FILTERS:
            raise DataError(
                f"'{name}' needs the filter {number} ({os.fsdecode(title)}), a program from "
                "elsewhere; write the file again with gzip (h5repack -f GZIP=4)"
            )
    return elsewhere


def _linked(file: "h5py.File", name: str, outside: Collection[str]) -> Any:
    """What a path with links on it leads to, or None; only links that are allowed are followed."""
    import h5py

    links, parts = _links(file), name.strip("/").split("/")
    for k in range(len(parts)):
        link = links.get("/".join(parts[: k + 1]))
        if isinstance(link, h5py.SoftLink):
            raise DataError(f"'{name}' is a link to '{link.path}' in the same file; give that name")
        if isinstance(link, h5py.ExternalLink):
            _refuse(name, "is a link to", {link.filename} - set(outside))
            return file.get(name)
    return None


def _refuse(name: str, how: str, files: Collection[str]) -> None:
    if files:
        listed = ", ".join(f"'{file}'" for file in sorted(files)[:3])
        raise DataError(
            f"'{name}' {how} another file: {listed}. If that is meant, allow it by this name "
            "(outside=, --outside), or write everything into one file (h5repack)"
        )
