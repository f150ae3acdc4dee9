"""Columns of files that hold named arrays: MAT, HDF5, NetCDF, NumPy.

What is wanted is looked at before it is read: where it is, how large, and that it is numbers.
"""

import struct
import zipfile
import zlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import xarray as xr

from backsight.data._hdf5 import check_dataset, check_links, datasets, wanted_names
from backsight.data._pick import pick
from backsight.data._room import check_density, check_room
from backsight.errors import DataError
from backsight.types import Array

_MODERN: dict[str, Any] = {"engine": "h5netcdf", "phony_dims": "sort"}
_CLASSIC: dict[str, Any] = {"engine": "scipy"}
"""How xarray reads NetCDF 4 (HDF5, perhaps without names of dimensions) and NetCDF 3."""

_COMPRESSED, _MATRIX = 15, 14
"""Kinds of the elements of a MAT file."""


def read_npz(path: Path, wanted: Sequence[str], _outside: Collection[str]) -> dict[str, Array]:
    """Read columns of a NumPy archive."""
    with zipfile.ZipFile(path) as archive:
        members = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}
        found: dict[str, Any] = dict.fromkeys(members)
        for name in wanted_names(wanted, members):
            if name in members:
                found[name] = _member(archive, members[name], name)
        return pick(found, wanted)


def read_mat(path: Path, wanted: Sequence[str], outside: Collection[str]) -> dict[str, Array]:
    """Read columns of a MATLAB file of version 5 to 7.3; a field of a structure is ``data/u``."""
    check_room(_mat_bytes(path), "the file")
    roots = list(dict.fromkeys(n.split("/")[0] for n in wanted_names(wanted, ())))
    try:
        variables = scipy.io.loadmat(path, simplify_cells=True, variable_names=roots)
        others = [name for name, *_ in scipy.io.whosmat(path)]
    except NotImplementedError:  # version 7.3 is HDF5
        return _read_hdf5(path, wanted, outside, column_major=True)
    except scipy.io.matlab.MatReadError as error:
        raise ValueError(str(error)) from error
    read = {k: v for k, v in variables.items() if not k.startswith("__")}
    return pick(dict.fromkeys(n for n in others if n not in read) | _flat(read), wanted)


def read_hdf5(path: Path, wanted: Sequence[str], outside: Collection[str]) -> dict[str, Array]:
    """Read columns of an HDF5 file; a dataset in a group is ``group/name``."""
    return _read_hdf5(path, wanted, outside, column_major=False)


def read_netcdf(path: Path, wanted: Sequence[str], outside: Collection[str]) -> dict[str, Array]:
    """Read columns of a NetCDF file; a variable in a group is ``group/name``."""
    import h5py

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
    return pick(variables, wanted)


def _read_hdf5(
    path: Path, wanted: Sequence[str], outside: Collection[str], *, column_major: bool
) -> dict[str, Array]:
    import h5py

    with h5py.File(path) as file:
        return pick(datasets(file, wanted, outside), wanted, column_major=column_major)


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> Array:
    """One array, if the archive holds what its head claims; objects are never unpickled."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read_head = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }.get(version)
        if read_head is None:
            raise DataError(f"'{name}' is of an unknown version of NumPy's format")
        shape, _, dtype = read_head(file)
        if dtype.hasobject:
            raise ValueError(f"'{name}' holds objects of Python, which are programs; write numbers")
        claimed, there = int(np.prod(shape, dtype=object)) * dtype.itemsize, member.file_size
        if claimed != there - file.tell():
            raise DataError(f"'{name}' claims the shape {shape}, but has {there} bytes")
    check_density(claimed, member.compress_size, f"'{name}'")
    check_room(max(claimed, claimed // max(dtype.itemsize, 1) * 8), f"'{name}'")
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


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
    leaves: dict[str, Any] = {}
    for name, entry in tree.items():
        if isinstance(entry, Mapping):
            leaves |= {f"{name}/{inner}": leaf for inner, leaf in _flat(entry).items()}
        else:
            leaves[name] = entry
    return leaves
