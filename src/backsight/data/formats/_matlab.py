"""Columns of MATLAB files of all versions: arrays, structures, cells, tables and timetables."""

import dataclasses
import math
import re
import struct
import warnings
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from backsight.data._pick import list_arrays, pick
from backsight.data._request import Contents, Listed, Request
from backsight.data._room import check_density, check_room
from backsight.data.formats._hdf5 import check_sources, datasets, leaves, wanted_names
from backsight.data.formats._mat_elements import check_elements
from backsight.data.formats._matlab_objects import MatlabObject, Objects, read_objects
from backsight.data.times.clock import seconds
from backsight.errors import DataError
from backsight.types import Array

_COMPRESSED, _MATRIX = 15, 14
"""Kinds of the elements of a MAT file."""

_ROOT = re.compile(r"[/\[({.]")
"""What ends the name of a variable in the path to what is inside."""


def read_mat(path: Path, request: Request) -> Contents:
    """Read columns of a MATLAB file of version 4 to 7.3.

    A field of a structure is ``data/u``, a column of a table ``tt/acc``. The time of a timetable is
    that of its columns, and ``tt/Time``.
    """
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return _picked(_modern(file, path, request), request)
    check_room(_mat_bytes(path), "the file")
    check_elements(path)
    return _picked(_classic(path, request.wanted), request)


def list_mat(path: Path, request: Request) -> list[Listed]:
    """List arrays, fields, cells and the columns of tables."""
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            roots = _object_roots(file)
            plain = {n: v for n, v in leaves(file).items() if n.split("/")[0] not in roots}
            own = _objects_of(file, path, roots, request).leaves if roots else {}
            return _listed({**own, **plain}, request)
    check_room(_mat_bytes(path), "the file")
    check_elements(path)
    found = _load(path, None)
    if "None" in found or any(isinstance(v, MatlabObject) for v in _flat(found).values()):
        return _listed(read_objects(path, None).leaves, request)
    return _listed(_flat(found), request)


def _picked(found: Objects, request: Request) -> Contents:
    arrays = found.leaves
    ours = {name: _ours(name, arrays) for name in request.wanted}
    for name in ours.values():
        _check_foreign(arrays, name)
    clock = ours.get(request.clock or "")
    dates = [clock] if clock is not None and clock in arrays and _is_date(arrays[clock]) else []
    numbers = [name for name in dict.fromkeys(ours.values()) if name not in dates]
    major = found.column_major
    taken = pick(arrays, numbers, axis=request.axis, column_major=major, clock=clock)
    taken |= {name: np.ravel(arrays[name]) for name in dates}
    columns = {name: taken[own] for name, own in ours.items()}
    units = {name: found.units[own] for name, own in ours.items() if own in found.units}
    time, begin = _own_time(found, request)
    return Contents(columns, units, time=time, begin=begin)


def _ours(name: str, arrays: Mapping[str, Any]) -> str:
    """The name by which an array is known that may be called as MATLAB does, counted from 1."""
    if next(wanted_names([name], arrays)) in arrays:
        return name
    own = _from_matlab(name)
    return own if next(wanted_names([own], arrays)) in arrays else name


def _own_time(found: Objects, request: Request) -> tuple[Array | None, str]:
    """Times of the timetable that all columns come from [s], and the date of their zero."""
    names = [_from_matlab(name).rpartition("/")[0] for name in request.wanted]
    table = names[0] if len(set(names)) == 1 else ""
    if request.clock is not None or table not in found.times:
        return None, ""
    return seconds(found.times[table], time_format=None, where=table)


def _listed(arrays: Mapping[str, Any], request: Request) -> list[Listed]:
    foreign = {name: entry for name, entry in arrays.items() if isinstance(entry, MatlabObject)}
    plain = {name: entry for name, entry in arrays.items() if name not in foreign}
    others = [Listed(name, "other", f"a {entry.kind} of MATLAB") for name, entry in foreign.items()]
    return [*list_arrays(plain, request.axis), *others]


def _classic(path: Path, wanted: Sequence[str]) -> Objects:
    """Leaves of the variables that are meant, and the names of the others, of version 4 to 7."""
    roots = _roots(wanted)
    read = _load(path, roots)
    found = _flat(read)
    lacking = [r for r in roots if r not in read]
    lacking += [r for r in read if any(_under(n, r) for n, v in found.items() if _is_foreign(v))]
    try:
        others: list[str] = [name for name, *_ in scipy.io.whosmat(path)] if lacking else []
    except TypeError:  # scipy knows no names where there are objects
        own = read_objects(path, lacking)
        plain = {n: v for n, v in found.items() if not _is_foreign(v)}
        return dataclasses.replace(own, leaves={**own.leaves, **plain})
    return Objects({**dict.fromkeys(n for n in others if n not in read), **found})


def _modern(file: Any, path: Path, request: Request) -> Objects:
    """The same of version 7.3, which is HDF5."""
    objects = _object_roots(file)
    roots = [root for root in _roots(request.wanted) if root in objects]
    if not roots:
        return Objects(datasets(file, request.wanted, request.outside), column_major=True)
    own = _objects_of(file, path, roots, request)
    rest = [n for n in request.wanted if _ROOT.split(n)[0] not in roots]
    plain = pick(datasets(file, rest, request.outside), rest, axis=request.axis, column_major=True)
    return dataclasses.replace(own, leaves={**own.leaves, **plain})


def _objects_of(file: Any, path: Path, roots: Sequence[str], request: Request) -> Objects:
    check_sources(file, request.outside)
    return read_objects(path, roots)


def _object_roots(file: Any) -> list[str]:
    """Variables that are objects or cells, or hold some."""
    import h5py

    roots: dict[str, None] = {}

    def collect(name: str, entry: Any) -> None:
        if name.startswith("#"):
            return
        refers = isinstance(entry, h5py.Dataset) and h5py.check_ref_dtype(entry.dtype) is not None
        kinds = (entry.attrs.get("MATLAB_class"), entry.parent.attrs.get("MATLAB_class"))
        if (
            refers and (kinds[0] == b"cell" or kinds[1] == b"struct")
        ) or "MATLAB_object_decode" in entry.attrs:
            roots[name.split("/")[0]] = None

    file.visititems(collect)  # follows no links
    return list(roots)


def _load(path: Path, roots: Sequence[str] | None) -> dict[str, Any]:
    try:
        with warnings.catch_warnings():  # objects are all called None
            warnings.simplefilter("ignore", scipy.io.matlab.MatReadWarning)
            found = scipy.io.loadmat(path, simplify_cells=True, variable_names=roots)
    except scipy.io.matlab.MatReadError as error:
        raise ValueError(str(error)) from error
    return {name: entry for name, entry in found.items() if not name.startswith("__")}


def _roots(wanted: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(_ROOT.split(name)[0] for name in wanted_names(wanted, ())))


def _under(name: str, root: str) -> bool:
    return name == root or (name.startswith(root) and _ROOT.match(name[len(root)]) is not None)


def _is_foreign(entry: Any) -> bool:
    return isinstance(entry, MatlabObject)


def _is_date(entry: Any) -> bool:
    return isinstance(entry, np.ndarray) and entry.dtype.kind in "mM"


def _check_foreign(arrays: Mapping[str, Any], name: str) -> None:
    """Raise `DataError` if what is wanted is inside an object that only MATLAB reads."""
    own = _from_matlab(name)
    for root, entry in arrays.items():
        if isinstance(entry, MatlabObject) and (_under(name, root) or _under(own, root)):
            raise DataError(f"'{root}' is an object of MATLAB's class '{entry.kind}'; {entry.way}")


def _from_matlab(name: str) -> str:
    """Our path to what MATLAB calls so: ``ch[1]/values`` for ``ch(2).values``, ``(:,1)`` is [0]."""
    counted = re.sub(r"[({](?::,\s*)?(\d+)[)}]", lambda m: f"[{int(m[1]) - 1}]", name)
    return counted.replace(".", "/")


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
        elif isinstance(entry, scipy.io.matlab.MatlabOpaque):
            leaves[name] = MatlabObject(entry["s2"].ravel()[0].decode())
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
        self.matrix.check_format(full_check=True)  # else rows of a damaged file may lie outside
        return np.array(self.matrix.toarray(), dtype=dtype, copy=copy)
