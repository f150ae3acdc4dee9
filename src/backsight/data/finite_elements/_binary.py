"""Matrices in MAT files, NumPy archives, HDF5."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from backsight.data.finite_elements.matrix import Matrix
from backsight.errors import DataError, nearest


def read_mat_matrix(path: Path, name: str | None) -> Matrix:
    """Read a matrix of a MAT file, sparse or full, of version 5 to 7.3."""
    import h5py

    if h5py.is_hdf5(path):
        with h5py.File(path) as file:
            return _chosen(path, name, dict(file), _from_hdf5)
    try:
        sizes = {n: s for n, s, _ in scipy.io.whosmat(path) if len(s) == 2}
        key = _key(
            path, name, {n: s for n, s in sizes.items() if 1 not in s} if not name else sizes
        )
        root = key.partition("/")[0]
        found: Any = scipy.io.loadmat(path, variable_names=[root], simplify_cells="/" in key)
        for part in key.split("/"):
            found = found[part]
    except (scipy.io.matlab.MatReadError, KeyError) as error:
        raise DataError(f"{path}: {error}") from None
    return _matrix(found, key)


def read_npz_matrix(path: Path, name: str | None) -> Matrix:
    """Read a matrix that `scipy.sparse.save_npz` wrote, or an array of an archive."""
    if not zipfile.is_zipfile(path):
        raise DataError(f"{path} is cut off, or no archive")
    with path.open("rb") as file, np.load(file) as archive:
        if "format" in archive.files and "shape" in archive.files:
            return _matrix(scipy.sparse.load_npz(path), path.stem)
        return _chosen(path, name, {k: archive[k] for k in archive.files}, lambda A: A)


def read_npy_matrix(path: Path) -> Matrix:
    """Read one array."""
    return _matrix(np.load(path), path.stem)


def _chosen(path: Path, name: str | None, found: dict[str, Any], convert: Any) -> Matrix:
    key = _key(path, name, {k: v for k, v in found.items() if not k.startswith("#")})
    return _matrix(convert(found[key]), key)


def _key(path: Path, name: str | None, found: Any) -> str:
    if name is None:
        if len(found) != 1:
            raise DataError(f"{path} has the matrices {', '.join(found)}; say which by name")
        return next(iter(found))
    if name.partition("/")[0] not in found and name not in found:
        raise DataError(f"{path} has no matrix '{name}': {nearest(name, found)}")
    return name


def _from_hdf5(entry: Any) -> Any:
    """A matrix of MATLAB 7.3: sparse ones are groups, full ones are stored column by column."""
    if "MATLAB_sparse" in entry.attrs:
        rows = int(entry.attrs["MATLAB_sparse"])
        columns = entry["jc"].shape[0] - 1
        data = entry["data"][()] if "data" in entry else np.zeros(0)
        inner = entry["ir"][()] if "ir" in entry else np.zeros(0, int)
        return scipy.sparse.csc_array((data, inner, entry["jc"][()]), shape=(rows, columns))
    return entry[()].T


def _matrix(found: Any, name: str) -> Matrix:
    if not scipy.sparse.issparse(found):
        found = np.asarray(found)
    if found.dtype.kind not in "biuf":
        raise DataError(f"'{name}' is no matrix of real numbers")
    if found.ndim != 2:
        raise DataError(f"'{name}' has {found.ndim} axes; a matrix has two")
    return Matrix(scipy.sparse.csc_array(found), name=name)
