"""Columns of files that hold named arrays: MAT, HDF5, NetCDF, NumPy.

What is wanted is looked at before it is read: where it is, how large, and that it is numbers.
"""

import dataclasses
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import scipy
import scipy.sparse
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

_COMPRESSED, _MATRIX = 15, 14
"""Kinds of the elements of a MAT file."""

ROOT = re.compile(r"[/\[({.]")
"""What ends the name of a variable in the path to what is inside."""


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


def read_mat(path: Path, request: Request) -> Contents:
    """Read columns of a MATLAB file of version 5 to 7.3; a field of a structure is ``data/u``."""
    check_room(_mat_bytes(path), "the file")
    wanted = request.wanted
    roots = list(dict.fromkeys(ROOT.split(n)[0] for n in wanted_names(wanted, ())))
    try:
        variables = scipy.io.loadmat(path, simplify_cells=True, variable_names=roots)
        others = [name for name, *_ in scipy.io.whosmat(path)]
    except NotImplementedError:  # version 7.3 is HDF5
        return _read_hdf5(path, request, column_major=True)
    except scipy.io.matlab.MatReadError as error:
        raise ValueError(str(error)) from error
    read = {k: v for k, v in variables.items() if not k.startswith("__")}
    leaves = dict.fromkeys(n for n in others if n not in read) | _flat(read)
    for name in wanted:  # as MATLAB calls it: ch(2).values, c{1}; counted from 1
        if name not in leaves and (own := _from_matlab(name)) in leaves:
            leaves[name] = leaves[own]
    return _picked(leaves, request)


def _from_matlab(name: str) -> str:
    """Our path to what MATLAB calls so: ``ch[1]/values`` for ``ch(2).values``."""
    counted = re.sub(r"[({](\d+)[)}]", lambda m: f"[{int(m[1]) - 1}]", name)
    return counted.replace(".", "/")


def read_hdf5(path: Path, request: Request) -> Contents:
    """Read columns of an HDF5 file; a dataset in a group is ``group/name``."""
    return _read_hdf5(path, request, column_major=False)


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
    """List the arrays of a MAT, HDF5, NetCDF or NumPy file, none read but those of MAT 4 to 7."""
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
    check_room(_mat_bytes(path), "the file")
    read = scipy.io.loadmat(path, simplify_cells=True)
    return list_arrays(_flat({k: v for k, v in read.items() if not k.startswith("__")}))


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


def _read_hdf5(path: Path, request: Request, *, column_major: bool) -> Contents:
    import h5py

    with h5py.File(path) as file:
        found = datasets(file, request.wanted, request.outside)
        return _picked(found, request, column_major=column_major)


def _picked(arrays: Mapping[str, Any], request: Request, *, column_major: bool = False) -> Contents:
    return Contents(pick(arrays, request.wanted, axis=request.axis, column_major=column_major))


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


def _mat_bytes(path: Path) -> int:
    """Size of all variables of a MAT file of version 5 when they are unpacked, as it claims."""
    total, end = 0, path.stat().st_size
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:128])
        while order and file.tell() + 8 <= end:
            kind, size = struct.unpack(f"{order}II", file.read(8))
            start = file.tell()
            if kind == _COMPRESSED:
                inside = zlib.decompressobj().decompress(file.read(min(size, 4096)), 8)
                kind, unpacked = struct.unpack(f"{order}II", inside.ljust(8, b"\0"))
                check_density(unpacked, size, "a variable")
            else:
                unpacked = size
            total += unpacked if kind == _MATRIX else 0
            file.seek(start + size)
    return total


def _flat(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Leaves of structures (``data/u``), arrays of them (``ch[2]/u``) and cells (``c[2]``)."""
    leaves: dict[str, Any] = {}
    for name, entry in tree.items():
        if isinstance(entry, Mapping):
            leaves |= {f"{name}/{inner}": leaf for inner, leaf in _flat(entry).items()}
        elif isinstance(entry, np.ndarray) and entry.dtype == object:
            cells = enumerate(entry.ravel(order="F"))
            leaves |= _flat({f"{name}[{k}]": cell for k, cell in cells})
        elif isinstance(entry, list):
            leaves |= _flat({f"{name}[{k}]": part for k, part in enumerate(entry)})
        elif scipy.sparse.issparse(entry):
            leaves[name] = _Sparse(entry)
        else:
            leaves[name] = entry
    return leaves


class _Sparse:
    """A sparse matrix, filled up with zeros when it is made an array."""

    def __init__(self, matrix: Any) -> None:
        self.matrix = matrix
        self.shape = matrix.shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Fill it up."""
        check_room(math.prod(self.shape) * np.dtype(float).itemsize, "a sparse matrix")
        return np.array(self.matrix.toarray(), dtype=dtype, copy=copy)
