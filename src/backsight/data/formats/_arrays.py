"""Columns of files that hold named arrays: HDF5, NetCDF, NumPy.

What is wanted is looked at before it is read: where it is, how large, and that it is numbers.
"""

import dataclasses
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr

from backsight.data._kinds import begins_with
from backsight.data._pick import list_arrays, pick
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats._hdf5 import check_dataset, check_links, datasets, leaves, wanted_names
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
    fields = {name: values[name] for name in dtype.names or ()}
    return _picked(fields or {"data": values}, request)


def read_hdf5(path: Path, request: Request) -> Contents:
    """Read columns of an HDF5 file; a dataset in a group is ``group/name``."""
    import h5py

    with h5py.File(path) as file:
        return _picked(datasets(file, request.wanted, request.outside), request)


def read_netcdf(path: Path, request: Request) -> Contents:
    """Read columns of a NetCDF file; a variable in a group is ``group/name``."""
    import h5py

    wanted, outside = request.wanted, request.outside
    modern = h5py.is_hdf5(path)
    names = list(dict.fromkeys([*wanted, *wanted_names(wanted, ())]))
    variables: dict[str, Any] = {}
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
            variables |= {f"{prefix}{k}": v for k, v in (dict.fromkeys(unread) | read).items()}
    return _picked(variables, request)


def list_containers(path: Path, request: Request) -> list[Listed]:
    """List the arrays of an HDF5, NetCDF or NumPy file; none is read."""
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return list_arrays(leaves(file), request.axis)
    if zipfile.is_zipfile(path):
        return list_arrays(_npz_arrays(path), request.axis)
    if begins_with(path, b"\x93NUMPY"):
        values = np.load(path, mmap_mode="r", allow_pickle=False)
        fields = {name: values[name] for name in values.dtype.names or ()}
        return list_arrays(fields or {"data": values}, request.axis)
    if begins_with(path, b"CDF"):
        with xr.open_dataset(path, decode_times=False, **_CLASSIC) as dataset:
            return list_arrays({str(k): v for k, v in dataset.variables.items()}, request.axis)
    raise DataError("this is no file of arrays")


def _npz_arrays(path: Path) -> dict[str, Any]:
    """Arrays of an archive as their heads claim them: nothing is unpacked."""
    found: dict[str, Any] = {}
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                found[name] = _Claimed(*_head(file, name))
    return found


@dataclasses.dataclass(frozen=True)
class _Claimed:
    shape: tuple[int, ...]
    dtype: np.dtype


def _picked(arrays: Mapping[str, Any], request: Request) -> Contents:
    return Contents(pick(arrays, request.wanted, axis=request.axis))


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
