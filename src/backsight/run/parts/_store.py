"""A folder of results, part by part: every file is whole or not there.

Not one file with an unlimited dimension: HDF5 has no journal, and a file that is being extended
when the process is killed cannot be opened any more. A part is written beside its place and moved
there in one step when it is on the disk, and the memory of the estimator after it likewise.
"""

import contextlib
import importlib.metadata
import json
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import xarray as xr

from backsight.errors import DataError, OutputError
from backsight.output import (
    folder_entries,
    holding,
    make_folder,
    netcdf_file,
    put_in_place,
    tidy,
    write_whole,
    writing,
)

ABOUT, MEMORY, SUMMARY = "about.json", "memory.npz", "summary.nc"
"""Files of a store beside its parts."""


class PartStore:
    """A folder that is written by one process at a time, see `opened_store`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def memory(self) -> dict[str, np.ndarray] | None:
        """What was kept after the last whole part; None at the beginning."""
        return self.read(MEMORY) if (self.folder / MEMORY).exists() else None

    def add(self, k: int, result: xr.Dataset | None, memory: Mapping[str, np.ndarray]) -> None:
        """Keep the results of part k, None if none of its samples are kept, and the memory."""
        if result is not None:
            self._write(f"part-{k:06}.nc", result)
        self.write(MEMORY, memory)

    def read(self, name: str) -> dict[str, np.ndarray]:
        """Arrays that were written under a name."""
        with np.load(self.folder / name, allow_pickle=False) as file:
            return dict(file)

    def write(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Write arrays under a name, all of them or nothing."""
        part = self.folder / f".{name}.{secrets.token_hex(4)}.part"
        with writing(self.folder):
            try:
                with part.open("wb") as file:
                    _save(file, arrays)
                put_in_place(part, self.folder / name)
            finally:
                part.unlink(missing_ok=True)

    def finish(self, summary: xr.Dataset) -> None:
        """Write what sums everything up; a store that has it is complete."""
        self._write(SUMMARY, summary)

    def _write(self, name: str, dataset: xr.Dataset) -> None:
        part = self.folder / f".{name}.{secrets.token_hex(4)}.part"
        with writing(self.folder):
            try:
                with netcdf_file(part) as file:
                    file.add(dataset)
                put_in_place(part, self.folder / name)
            finally:
                part.unlink(missing_ok=True)


@contextlib.contextmanager
def opened_store(out: Path, *, said: str) -> Iterator[PartStore]:
    """Open a store for writing, alone.

    Parameters
    ----------
    out : Path
        Folder; missing ones are made.
    said : str
        Digest of what is estimated; a store of something else is refused.

    Raises
    ------
    OutputError
        If another process writes to it, it holds something else, or it cannot be written.
    """
    with writing(out):
        make_folder(out)
    with holding(out):
        about = out / ABOUT
        if about.exists():
            _check_same(about, said)
        else:
            if foreign := folder_entries(out):
                raise OutputError(
                    f"'{out}' has files that are not from here, such as {foreign[0]}; choose "
                    "another folder"
                )
            version = importlib.metadata.version("backsight")
            content = {"program": "backsight", "version": version, "of": said}
            write_whole(about, json.dumps(content, indent=1).encode())
        with writing(out):
            tidy(out)
        yield PartStore(out)


def _check_same(about: Path, said: str) -> None:
    try:
        found = json.loads(about.read_text(encoding="utf-8"))
        version, of = found["version"], found["of"]
    except (OSError, ValueError, KeyError, TypeError):
        raise OutputError(f"'{about}' is not from here; choose another folder") from None
    here = importlib.metadata.version("backsight")
    if version != here:
        raise OutputError(
            f"'{about.parent}' was begun with version {version} of Backsight, this is {here}; go "
            "on with the same one, or choose another folder"
        )
    if of != said:
        raise OutputError(
            f"'{about.parent}' holds results of another estimator, model, recording or choice of "
            "outputs; choose another folder"
        )


def read_store(
    store: str | os.PathLike[str],
    *,
    variables: Sequence[str] | None = None,
    start: float = -np.inf,
    stop: float = np.inf,
) -> xr.Dataset:
    """Read results that `estimate_parts` has written.

    Parameters
    ----------
    store : path
    variables : sequence of str, optional
        Which ones; all if not given.
    start, stop : float
        Keep the samples with ``start <= t < stop`` [s]; only parts with such samples are read.

    Returns
    -------
    xarray.Dataset
        As of `backsight.estimate`.

    Raises
    ------
    DataError
        If there are no such results.

    Examples
    --------
    >>> import h5py, numpy as np
    >>> with h5py.File("long.h5", "w") as file:
    ...     file["u"], file["y"] = np.zeros(60), np.zeros(60)
    >>> parts = bs.large.read_parts(
    ...     "long.h5", inputs={"u": "u"}, outputs={"y": "y"}, dt=0.01, samples=20
    ... )
    >>> model = bs.sdof(k=40.0, b=0.8)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=0.1))
    >>> told = bs.large.estimate_parts(kf, model, parts, "store", outputs=["x_std"])
    >>> bs.large.read_store("store", start=0.2, stop=0.4).sizes["time"]
    20
    """
    found: list[xr.Dataset] = []
    for path in sorted(Path(store).glob("part-*.nc")):
        with xr.open_dataset(path, engine="h5netcdf") as part:
            inside = (part["time"].values >= start) & (part["time"].values < stop)
            if inside.any():
                kept = part if variables is None else part[[*variables]]
                found.append(kept.isel(time=inside).load())
    if not found:
        raise DataError(f"{store} holds no results from {start} to {stop} s")
    return _joined(found)


def _joined(found: Sequence[xr.Dataset]) -> xr.Dataset:
    joined: Any = xr.concat(
        [*found], "time", data_vars="minimal", coords="minimal", combine_attrs="override"
    )
    return joined


def _save(file: IO[bytes], arrays: Mapping[str, Any]) -> None:
    np.savez(file, **arrays)
