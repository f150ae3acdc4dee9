"""The file ``estimates.nc``: every result as a group with the name of its estimator."""

import dataclasses
import os
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from backsight.data.formats import check_dataset, check_links
from backsight.errors import DataError
from backsight.output import netcdf_file
from backsight.schema import check_estimates

if TYPE_CHECKING:
    import h5py


@dataclasses.dataclass(frozen=True)
class SavedRun:
    """What is in a file.

    Parameters
    ----------
    title, problem : str
        Title and text of the problem file.
    results : dict
        Name of the estimator to its result.
    """

    title: str
    problem: str
    results: Mapping[str, xr.Dataset]


def write_estimates(
    path: Path, results: Mapping[str, xr.Dataset], *, title: str, problem: str, covariance: bool
) -> None:
    """Write results, compressed.

    Parameters
    ----------
    path : Path
        The file.
    results : dict
        Name to result.
    title, problem : str
        Kept with them.
    covariance : bool
        Whether to write ``P``, n numbers for each of n states and sample. Standard deviations are
        always written.
    """
    about = {"title": title, "problem": problem, "backsight": version("backsight")}
    with netcdf_file(path) as file:
        file.add(xr.Dataset(attrs=about))
        for name, result in results.items():
            kept = result if covariance else result.drop_vars("P", errors="ignore")
            file.add(kept, group=name, compressed=True)


def _check_group(group: "h5py.Group", name: str) -> None:
    """Raise `DataError` if its numbers come from elsewhere."""
    import h5py

    for inner, entry in group.items():
        if isinstance(entry, h5py.Dataset) and entry.dtype.kind in "fiub" and entry.shape:
            check_dataset(entry, f"{name}/{inner}", ())


def read_estimates(path: str | os.PathLike[str]) -> SavedRun:
    """Read a file that a run has written.

    Parameters
    ----------
    path : path
        ``estimates.nc``.

    Raises
    ------
    DataError
        If it cannot be read, holds no result, or takes its numbers from other files.
    """
    import h5py

    try:
        with h5py.File(path) as file:
            check_links(file, ())
            inside = {n: entry for n, entry in file.items() if isinstance(entry, h5py.Group)}
            for name, group in inside.items():
                _check_group(group, name)
        with xr.open_dataset(path, engine="h5netcdf") as root:
            about = dict(root.attrs)
        results = {g: xr.load_dataset(path, group=g, engine="h5netcdf") for g in inside}
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path} cannot be read as results of a run: {error}") from None
    if not results:
        raise DataError(f"{path} holds no results: give the estimates.nc that a run has written")
    for name, result in results.items():
        check_estimates(result, name)
        result["status"] = result["status"].astype(np.int32)
    return SavedRun(str(about.get("title", "")), str(about.get("problem", "")), results)
