"""Columns of files that hold named arrays: MAT, HDF5, NetCDF, NumPy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import xarray as xr

from backsight.data._pick import pick
from backsight.types import Array


def read_npz(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Read columns of a NumPy archive."""
    with path.open("rb") as file, np.load(file) as archive:
        return pick(archive, wanted)


def read_mat(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Read columns of a MATLAB file of version 5 to 7.3; a field of a structure is ``data/u``."""
    try:
        variables = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        return _read_hdf5(path, wanted, column_major=True)
    except scipy.io.matlab.MatReadError as error:
        raise ValueError(str(error)) from error
    return pick(_flat({k: v for k, v in variables.items() if not k.startswith("__")}), wanted)


def read_hdf5(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Read columns of an HDF5 file; a dataset in a group is ``group/name``."""
    return _read_hdf5(path, wanted, column_major=False)


def read_netcdf(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Read columns of a NetCDF file; a variable in a group is ``group/name``."""
    variables: dict[str, Any] = {}
    for group in dict.fromkeys(name.rpartition("/")[0] for name in wanted):
        prefix = f"{group}/" if group else ""
        with (
            path.open("rb") as file,
            xr.open_dataset(file, group=group or None, decode_times=False) as dataset,
        ):
            variables |= {f"{prefix}{k}": v.to_numpy() for k, v in dataset.variables.items()}
    return pick(variables, wanted)


def _read_hdf5(path: Path, wanted: Sequence[str], *, column_major: bool) -> dict[str, Array]:
    import h5py

    datasets: dict[str, Any] = {}

    def collect(name: str, entry: Any) -> None:
        if isinstance(entry, h5py.Dataset) and not name.startswith("#"):  # MATLAB's own: "#refs#"
            datasets[name] = entry

    with h5py.File(path) as file:
        file.visititems(collect)
        return pick(datasets, wanted, column_major=column_major)


def _flat(tree: Mapping[str, Any]) -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for name, entry in tree.items():
        if isinstance(entry, Mapping):
            leaves |= {f"{name}/{inner}": leaf for inner, leaf in _flat(entry).items()}
        else:
            leaves[name] = entry
    return leaves
