"""Columns of files that hold named arrays: HDF5, NetCDF, NumPy.

What is wanted is looked at before it is read: where it is, how large, and that it is numbers.
"""

import dataclasses
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr

from backsight.data._kinds import begins_with
from backsight.data._pick import INDEXED, list_arrays, pick
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats._hdf5 import (
    Field,
    check_dataset,
    check_links,
    datasets,
    leaves,
    wanted_names,
)
from backsight.data.formats.conventions import (
    PACKED,
    counts_from_date,
    dates,
    physical_values,
    unit_in,
)
from backsight.errors import DataError
from backsight.types import Array

_MODERN: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "sort"}
_CLASSIC: dict[str, Any] = {"engine": "scipy"}
"""How xarray reads NetCDF 4 (HDF5, perhaps without names of dimensions) and NetCDF 3."""


def read_npz(path: Path, request: Request) -> Contents:
    """Read columns of a NumPy archive."""
    with zipfile.ZipFile(path) as archive:
        members = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}
        found: dict[str, Any] = dict.fromkeys(members)
        for name in wanted_names(request.wanted, members):
            if name in members:
                found[name] = _member(archive, members[name], name)
            elif (table := name.rpartition("/")[0]) in members:  # a column of a structured array
                found |= _fields(_member(archive, members[table], table), table)
        return _picked(found, request)


def read_npy(path: Path, request: Request) -> Contents:
    """Read columns of one NumPy array: ``data[2]``, or the fields of a structured one by name."""
    with path.open("rb") as file:
        shape, dtype = _head(file, "data")
        claimed, there = int(np.prod(shape, dtype=object)) * dtype.itemsize, path.stat().st_size
        if claimed != there - file.tell():
            raise DataError(f"the head claims the shape {shape}, but there are {there} bytes")
        check_room(max(claimed, claimed // max(dtype.itemsize, 1) * 8), "the array")
        file.seek(0)
        values = np.lib.format.read_array(file, allow_pickle=False)
    return _picked(_fields(values) or {"data": values}, request)


def _fields(values: Any, table: str = "") -> dict[str, Any]:
    prefix = f"{table}/" if table else ""
    return {f"{prefix}{name}": values[name] for name in values.dtype.names or ()}


def read_hdf5(path: Path, request: Request) -> Contents:
    """Read columns of an HDF5 file; a dataset in a group is ``group/name``."""
    import h5py

    with h5py.File(path) as file:
        found = datasets(file, request.wanted, request.outside)
        columns = _picked(found, request).columns
        told = {name: _attributes(found, name) for name in columns}
        plain = {name: physical_values(values, told[name]) for name, values in columns.items()}
        changed = [f"'{name}'" for name in plain if plain[name] is not columns[name]]
        note = f"{', '.join(changed)} unpacked as the attributes say"
        return _told(plain, told, request, note if changed else "")


def _attributes(found: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Of the dataset of a column, those that say something of its numbers."""
    indexed = INDEXED.fullmatch(name)
    entry = found[indexed["name"] if indexed and name not in found else name]
    attributes = entry.table.attrs if isinstance(entry, Field) else entry.attrs
    known = (*PACKED, "units", "unit", "Units", "calendar")
    return {key: attributes[key] for key in known if key in attributes}


def _told(
    columns: Mapping[str, Array],
    attributes: Mapping[str, Mapping[str, Any]],
    request: Request,
    note: str = "",
) -> Contents:
    """Columns with their units; a clock that counts from a date on becomes dates."""
    clock = request.clock
    if clock is not None and counts_from_date(attributes[clock]):
        columns = {**columns, clock: dates(columns[clock], attributes[clock], clock)}
    units = {name: unit_in(told) for name, told in attributes.items() if not counts_from_date(told)}
    return Contents(columns, {name: unit for name, unit in units.items() if unit}, note)


def read_netcdf(path: Path, request: Request) -> Contents:
    """Read columns of a NetCDF file; a variable in a group is ``group/name``."""
    import h5py

    wanted, outside = request.wanted, request.outside
    modern = h5py.is_hdf5(path)
    names = list(dict.fromkeys([*wanted, *wanted_names(wanted, ())]))
    variables: dict[str, Any] = {}
    attributes: dict[str, Any] = {}
    with path.open("rb") as file:
        for group in dict.fromkeys(name.rpartition("/")[0] for name in names):
            prefix = f"{group}/" if group else ""
            unread = []
            if modern:
                with h5py.File(file) as plain:
                    check_links(plain, outside)
                    for name in names:
                        if isinstance(entry := plain.get(name), h5py.Dataset):
                            check_dataset(entry, name, outside)
                    place = plain.get(group or "/")
                    inside = list(place) if isinstance(place, h5py.Group) else []
                    unread = [name for name in inside if f"{prefix}{name}" not in names]
                file.seek(0)
            with xr.open_dataset(
                file,
                group=group or None,
                decode_times=False,
                drop_variables=unread,
                **(_MODERN if modern else _CLASSIC),
            ) as dataset:
                read = {k: v.to_numpy() for k, v in dataset.variables.items()}
                attributes |= {f"{prefix}{k}": v.attrs for k, v in dataset.variables.items()}
            variables |= {f"{prefix}{k}": v for k, v in (dict.fromkeys(unread) | read).items()}
    columns = _picked(variables, request).columns
    places = {n: INDEXED.fullmatch(n) for n in columns}
    told = {n: attributes.get(m["name"] if m else n, {}) for n, m in places.items()}
    return _told(columns, told, request)


def list_containers(path: Path, request: Request) -> list[Listed]:
    """List the arrays of an HDF5, NetCDF or NumPy file; none is read."""
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            arrays = leaves(file)
            dated = {
                n
                for n, v in arrays.items()
                if not isinstance(v, Field) and counts_from_date(v.attrs)
            }
            return _listed(arrays, dated, request)
    if zipfile.is_zipfile(path):
        return list_arrays(_npz_arrays(path), request.axis)
    if begins_with(path, b"\x93NUMPY"):
        values = np.load(path, mmap_mode="r", allow_pickle=False)
        return list_arrays(_fields(values) or {"data": values}, request.axis)
    if begins_with(path, b"CDF"):
        with xr.open_dataset(path, decode_times=False, **_CLASSIC) as dataset:
            arrays = {str(k): v for k, v in dataset.variables.items()}
            return _listed(
                arrays, {n for n, v in arrays.items() if counts_from_date(v.attrs)}, request
            )
    raise DataError("this is no file of arrays")


def _dated(arrays: Mapping[str, Any]) -> set[str]:
    return {name for name, entry in arrays.items() if counts_from_date(entry.attrs)}


def _listed(arrays: Mapping[str, Any], dated: Collection[str], request: Request) -> list[Listed]:
    """Arrays as listed; those that count from a date on are dates."""
    found = list_arrays(arrays, request.axis)
    return [dataclasses.replace(c, kind="dates") if c.name in dated else c for c in found]


def _npz_arrays(path: Path) -> dict[str, Any]:
    """Arrays of an archive as their heads claim them: nothing is unpacked."""
    found: dict[str, Any] = {}
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                shape, dtype = _head(file, name)
            fields = {f"{name}/{field}": dtype[field] for field in dtype.names or ()}
            found |= {n: _Claimed((*shape, *d.shape), d.base) for n, d in fields.items()}
            if not fields:
                found[name] = _Claimed(shape, dtype)
    return found


@dataclasses.dataclass(frozen=True)
class _Claimed:
    shape: tuple[int, ...]
    dtype: np.dtype


def _picked(arrays: Mapping[str, Any], request: Request) -> Contents:
    return Contents(pick(arrays, request.wanted, axis=request.axis, clock=request.clock))


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> Array:
    """One array, if the archive holds what its head claims; objects are never unpickled."""
    with archive.open(member) as file:
        shape, dtype = _head(file, name)
        claimed, there = int(np.prod(shape, dtype=object)) * dtype.itemsize, member.file_size
        if claimed != there - file.tell():
            raise DataError(f"'{name}' claims the shape {shape}, but has {there} bytes")
    check_density(claimed, member.compress_size, f"'{name}'")
    check_room(max(claimed, claimed // max(dtype.itemsize, 1) * 8), f"'{name}'")
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _head(file: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and kind that the head of an array in NumPy's format claims."""
    read_head = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(np.lib.format.read_magic(file))
    if read_head is None:
        raise DataError(f"'{name}' is of an unknown version of NumPy's format")
    shape, _, dtype = read_head(file)
    if dtype.hasobject:
        raise ValueError(f"'{name}' holds objects of Python, which are programs; write numbers")
    return shape, dtype
