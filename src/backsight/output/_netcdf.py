"""NetCDF files on disks that may be full.

HDF5 does not live through a write that fails: what it could not write it tries again when its
objects are collected, and again when the process ends, with errors that nobody can catch, and a
crash at times; an interrupt within a write is such a failure, too. So a file is made in memory,
where nothing fails and nothing interrupts it, and then written by ourselves.
"""

import contextlib
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

COMPRESSED = {"zlib": True, "complevel": 4, "shuffle": True}


class NetcdfFile:
    """A file that is being made, see `netcdf_file`."""

    def __init__(self, root: Any) -> None:
        self._root = root

    def add(
        self, dataset: "xr.Dataset", *, group: str | None = None, compressed: bool = False
    ) -> None:
        """Take in a dataset, as a group if it has a name."""
        from xarray.backends import H5NetCDFStore

        home = self._root if group is None else self._root.create_group(group)
        numbers = [n for n, v in dataset.data_vars.items() if v.dtype.kind in "fi" and v.size]
        encoding: Mapping[Any, Any] = dict.fromkeys(numbers, COMPRESSED) if compressed else {}
        dataset.dump_to_store(H5NetCDFStore(home, mode="w"), encoding=encoding)


@contextlib.contextmanager
def netcdf_file(path: Path) -> Iterator[NetcdfFile]:
    """Make a NetCDF file, and write it when the block ends without an error.

    Raises
    ------
    OSError
        If the disk refuses something.
    """
    import h5netcdf

    content = io.BytesIO()
    with h5netcdf.File(content, "w") as root:
        yield NetcdfFile(root)
    with path.open("wb") as file:
        file.write(content.getbuffer())
