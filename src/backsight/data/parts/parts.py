"""A recording in parts that follow each other, of which one at a time is in memory."""

import dataclasses
import glob
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from backsight.data.columns import Column, ColumnLike, column, columns
from backsight.data.derived import convert_units
from backsight.data.parts._columns import opened
from backsight.data.reader import read
from backsight.data.recording import Group, as_recording
from backsight.description import Count, Printed, checked
from backsight.errors import DataError
from backsight.types import Array

LATE = 0.01
"""Share of a sampling period by which a part may begin beside where the last one ends."""

Stamp = tuple[str, int, int]
"""Path, size and time of the last change [ns] of a file."""


@dataclasses.dataclass(frozen=True)
class RecordingParts(Printed):
    """A recording in parts, see `read_parts`.

    Parameters
    ----------
    files : tuple of Path
        One, of which the parts are rows, or one for each part.
    samples : int
        Rows of a part of one file.
    rows : int
        Rows of one file; 0 if the files are the parts.
    dt : float, optional
        Sampling period [s]; None is that of the first part.
    inputs, outputs : dict
        Signals to columns.
    time : Column, optional
    format : str, optional
        As of `backsight.read`.
    units : dict
        Signals to the units that they are converted to; those without one keep theirs.
    """

    files: tuple[Path, ...]
    samples: int
    rows: int
    dt: float | None
    inputs: Mapping[str, Column]
    outputs: Mapping[str, Column]
    time: Column | None
    format: str | None
    units: Mapping[str, str]

    @property
    def count(self) -> int:
        """Number of parts."""
        return -(-self.rows // self.samples) if self.rows else len(self.files)

    def stamp(self, k: int) -> Stamp:
        """By what a part is known again without reading it."""
        path = self.files[0 if self.rows else k]
        about = path.stat()
        return str(path), about.st_size, about.st_mtime_ns

    def recording(self, k: int) -> xr.Dataset:
        """Read part k.

        Raises
        ------
        DataError
            If it cannot be read, or its file changes meanwhile.
        """
        before = self.stamp(k)
        found = self._slice(k) if self.rows else self._file(k)
        if self.stamp(k) != before:
            raise DataError(f"{before[0]} changes while it is read; wait until it is whole")
        return convert_units(found, self.units) if self.units else found

    def _file(self, k: int) -> xr.Dataset:
        return read(
            self.files[k],
            inputs=self.inputs,
            outputs=self.outputs,
            time=self.time,
            dt=self.dt,
            format=self.format,
        )

    def _slice(self, k: int) -> xr.Dataset:
        path, start = self.files[0], k * self.samples
        stop = min(start + self.samples, self.rows)
        groups = (self.inputs, self.outputs)
        chosen = [c for group in groups for c in group.values()]
        wanted = dict.fromkeys(c.name for c in [*chosen, *([self.time] if self.time else [])])
        with opened(path, list(wanted)) as file:
            raw, units = file.read(start, stop), file.units
        stamps: Array = (
            self.time.physical(raw[self.time.name])
            if self.time
            else (self.dt or 1.0) * np.arange(start, stop, dtype=float)
        )
        u, y = (_group(group, raw, units, len(stamps)) for group in groups)
        return as_recording(stamps, u=u, y=y, dt=self.dt, first=start, where=str(path))


def _group(
    signals: Mapping[str, Column], raw: Mapping[str, Array], units: Mapping[str, str], n: int
) -> Group:
    values = [c.settled(units[c.name]).physical(raw[c.name]) for c in signals.values()]
    return Group(
        np.stack(values, axis=1) if values else np.empty((n, 0)),
        {name: c.unit_by(units[c.name]) for name, c in signals.items()},
    )


@checked(DataError, only=("samples",))
def read_parts(
    source: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    inputs: Mapping[str, ColumnLike],
    outputs: Mapping[str, ColumnLike],
    time: ColumnLike | None = None,
    dt: float | None = None,
    samples: Count = 1_000_000,
    format: str | None = None,  # noqa: A002  the word of problem files
    units: Mapping[str, str] | None = None,
) -> RecordingParts:
    """Open a recording that need not fit into memory; see `backsight.large.estimate_parts`.

    Parameters
    ----------
    source : path, or sequence of paths
        One HDF5, NetCDF 4 or Parquet file with a column for each signal, read in parts of
        `samples` rows; or a folder, a pattern such as ``run/*.csv``, or a list of files of any kind
        that `backsight.read` reads, each of which is a part, in the order of their names.
    inputs, outputs, time, dt, format
        As of `backsight.read`. Time must be numbers. In files without time every part begins where
        the one before ends.
    samples : int
        Samples of a part of one file.
    units : dict, optional
        Name of a signal to the unit that it is converted to, see `backsight.data.convert_units`.

    Returns
    -------
    RecordingParts

    Raises
    ------
    DataError
        If there is no such file, a column is missing, or the file cannot be read in parts.

    Examples
    --------
    >>> import h5py, numpy as np
    >>> with h5py.File("long.h5", "w") as file:
    ...     file["u"], file["y"] = np.zeros(60), np.zeros(60)
    >>> parts = bs.large.read_parts(
    ...     "long.h5", inputs={"u": "u"}, outputs={"y": "y"}, dt=0.01, samples=20
    ... )
    >>> type(parts).__name__
    'RecordingParts'
    """
    signals = columns(inputs, "input"), columns(outputs, "output")
    clock = None if time is None else column(time, "time")
    for name, c in (*signals[0].items(), *signals[1].items()):
        if c.remove_mean or c.delay:
            raise DataError(f"'{name}': remove_mean and delay need the whole recording")
    if clock is None and dt is None:
        raise DataError("give the column of time, or the sampling period dt")
    if not isinstance(source, str | os.PathLike):
        files, one = tuple(map(Path, source)), False
    else:
        files, one = _files(Path(source))
    if not files:
        raise DataError(f"{source}: there is no file")
    rows = 0
    if one:
        chosen = [c.name for group in signals for c in group.values()] + (
            [clock.name] if clock else []
        )
        with opened(files[0], list(dict.fromkeys(chosen))) as file:
            rows = file.count
        if rows % samples == 1:  # a part needs two samples to have a period
            samples += 1
        if rows < 2 or samples < 2:
            raise DataError(f"{source}: a recording and its parts need at least 2 samples")
    return RecordingParts(
        files=files,
        samples=samples,
        rows=rows,
        dt=dt,
        inputs=signals[0],
        outputs=signals[1],
        time=clock,
        format=format,
        units=dict(units or {}),
    )


def _files(path: Path) -> tuple[tuple[Path, ...], bool]:
    """Files that are meant, in order, and whether it is one whose rows are the parts."""
    if path.is_file():
        return (path,), True
    if path.is_dir():
        found = [p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")]
    else:
        found = [Path(name) for name in glob.glob(str(path))]
    return tuple(sorted(found)), False
