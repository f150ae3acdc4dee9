"""Read a recording from a file."""

import contextlib
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
import xarray as xr

from backsight.data import _checks as checks
from backsight.data._containers import read_hdf5, read_mat, read_netcdf, read_npz
from backsight.data._pick import pick
from backsight.data._room import check_room
from backsight.data._text_files import read_text
from backsight.data.columns import Column, ColumnLike, column, columns
from backsight.data.recording import Group, as_recording, time_axis
from backsight.description import Whole, checked
from backsight.errors import DataError, PluginError, nearest
from backsight.plugins import Extended
from backsight.schema import SIGMA_FACTOR
from backsight.types import Array

TEXT = (".csv", ".tsv", ".txt")
"""Extensions of text files."""

Reader: TypeAlias = Callable[[Path, Sequence[str], Collection[str]], Mapping[str, Array]]
"""``(path, names of the wanted columns, outside) -> {name: values}``, time first."""

CONTAINERS: Mapping[str, Reader] = {
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".nc": read_netcdf,
    ".npz": read_npz,
}
"""Extension to reader of the files that hold named arrays."""


UNREADABLE = (OSError, ValueError, LookupError, EOFError, MemoryError)
"""What a sound reader may raise on files that are cut off or of another kind."""

ExtensionReader: TypeAlias = Callable[[Path, Sequence[str]], Mapping[str, Array]]
"""``(path, names of the wanted columns) -> {name: values}``, what an extension brings."""


def _text(path: Path, wanted: Sequence[str], _outside: Collection[str]) -> Mapping[str, Array]:
    return read_text(path, wanted, 0)


def _adopted(key: str, found: object) -> Reader:
    """Somebody else's reader, which may return more columns than are wanted, and lists."""
    if not callable(found):
        raise DataError(f"it must be a function (path, wanted) -> columns by name, not {found!r}")

    def reader(path: Path, wanted: Sequence[str], _outside: Collection[str]) -> Mapping[str, Array]:
        columns = found(path, wanted)
        if not isinstance(columns, Mapping):
            raise DataError(f"the reader of '{key}' files returned no columns by name")
        return pick({name: np.asarray(values) for name, values in columns.items()}, wanted)

    return reader


READERS = Extended(
    "backsight.readers",
    "reader",
    # Text is told apart because lines can be skipped in it.
    {**dict.fromkeys(TEXT, _text), **CONTAINERS},
    _adopted,
    prefix=".",
)
"""Extension to reader: ours, and those of installed extensions (``rl2`` reads ``.rl2``)."""


@checked(DataError, only=("skip_lines",))
def read(
    path: str | os.PathLike[str],
    *,
    inputs: Mapping[str, ColumnLike],
    outputs: Mapping[str, ColumnLike],
    time: ColumnLike | None = None,
    dt: float | None = None,
    truth: Mapping[str, ColumnLike] | None = None,
    start: float | None = None,
    stop: float | None = None,
    resample: float | None = None,
    skip_lines: Whole = 0,
    sigma_factor: Mapping[str, ColumnLike] | None = None,
    outside: Collection[str] = (),
) -> xr.Dataset:
    r"""Read a recording and check it.

    Parameters
    ----------
    path : path
        Text (``.csv``, ``.tsv``, ``.txt``; first line or last comment names the columns), MATLAB
        (``.mat``), HDF5 (``.h5``, ``.hdf5``), NetCDF (``.nc``), NumPy (``.npz``), or what an
        installed extension reads.
    inputs, outputs : dict
        Name of the signal in the model to the column: its name, a `Column` with unit and factor,
        or a mapping with the fields of one. ``group/name`` reads from a structure or group,
        ``acc[2]`` the third column of a matrix. An empty cell or ``NaN`` in an output is "not
        measured".
    time : column, optional
        Time stamps [s]; ``Column("t_ms", factor=1e-3)`` for milliseconds.
    dt : float, optional
        Sampling period [s]; needed if there is no `time`.
    truth : dict, optional
        Reference values of states, as `outputs`; they become ``x_true (time, state)``.
    start, stop : float, optional
        Keep the samples with ``start <= t < stop`` [s].
    resample : float, optional
        Interpolate to this sampling period [s]; see `backsight.data.resample`.
    skip_lines : int
        Lines to pass over at the top of a text file.
    sigma_factor : dict, optional
        Outputs whose samples have a noise of their own, as `outputs`: the column holds its standard
        deviation by the `sigma_y` of the estimator, or, with ``Column(name, factor=1 / sigma_y)``,
        the standard deviation itself. An empty cell is "not measured".
    outside : collection of str
        Other files from which an HDF5, NetCDF or MAT file may take measurements (external storage,
        external links, virtual datasets), by the names that it has for them. The file must be
        trusted then: it could name any file of the computer.

    Returns
    -------
    xarray.Dataset
        ``u (time, input)`` and ``y (time, output)``, as `backsight.schema.recording` makes it.

    Raises
    ------
    DataError
        If the file or a column is missing or cannot be read, does not fit into memory, or takes
        measurements from other files or needs other programs to be read; the recording is empty,
        its time is not regular, an input is not known at every sample, an output is infinite, or a
        factor of the noise is not positive or belongs to no output.
    PluginError
        If the reader of an extension is broken.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "stage.csv")
    >>> _ = path.write_text("t,u_V,y_um\n0.0,1.5,0.0\n0.1,-1.5,\n0.2,1.5,0.3\n")
    >>> drive = Column("u_V", unit="V")
    >>> recording = read(path, inputs={"V": drive}, outputs={"y": "y_um"}, time="t")
    >>> recording.y.to_numpy().ravel()
    array([0. , nan, 0.3])
    >>> folder.cleanup()
    """
    path = Path(path)
    signals = [
        columns(inputs, "input"),
        columns(outputs, "output"),
        columns(truth or {}, "truth"),
        columns(sigma_factor or {}, SIGMA_FACTOR),
    ]
    for name in signals[3]:
        if name not in outputs:
            raise DataError(
                f"{SIGMA_FACTOR}: there is no output '{name}': {nearest(name, outputs)}"
            )
    clock = None if time is None else column(time, "time")
    if not signals[0] and not signals[1]:
        raise DataError(f"{path}: name at least one column as input or output")
    chosen = [c for group in signals for c in group.values()] + ([clock] if clock else [])
    raw = _load(path, list(dict.fromkeys(c.name for c in chosen)), skip_lines, outside)

    where = str(path)
    n = checks.check_lengths({name: len(values) for name, values in raw.items()}, where)
    given = clock.physical(raw[clock.name]) if clock else None
    stamps = time_axis(given, n, dt=dt, where=where)
    kept = _selected(stamps, start, stop, where)
    u, y, x, factors = (_group(group, raw, kept) for group in signals)
    return as_recording(
        stamps[kept],
        u=u,
        y=y,
        x=x if truth else None,
        sigma_factor=_spread(factors, y) if sigma_factor else None,
        dt=dt,
        resample=resample,
        first=kept.start,
        where=where,
    )


def _load(
    path: Path, wanted: Sequence[str], skip_lines: int, outside: Collection[str]
) -> Mapping[str, Array]:
    kind = path.suffix.lower()
    _check_file(path, READERS)
    if kind not in READERS:
        hint = nearest(kind, READERS)
        raise DataError(f"{path}: files of the kind '{kind}' are not read: {hint}")
    if skip_lines and kind not in TEXT:
        raise DataError(f"{path}: skip_lines is for text files, not for '{kind}'")
    reader = READERS[kind]
    try:
        if kind in TEXT:
            check_room(path.stat().st_size, "the file")
            return read_text(path, wanted, skip_lines)
        with READERS.blamed(kind, but=UNREADABLE):
            return reader(path, wanted, outside)
    except PluginError:
        raise
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    except MemoryError:
        raise DataError(f"{path} does not fit into memory; cut the recording") from None
    # Readers that others wrote may raise anything on files that are damaged or made to harm.
    except Exception as error:
        reason = str(error).partition("\n")[0]
        raise DataError(f"{path} cannot be read as a '{kind}' file: {reason}") from error


def _check_file(path: Path, known: Collection[str]) -> None:
    """Raise `DataError` unless there is a file, which ends; a device or a pipe may not."""
    try:
        if not path.exists():
            raise DataError(f"there is no file '{path}'{_neighbour(path, known)}")
        if path.is_dir():
            raise DataError(f"'{path}' is a folder; give a file")
        if not path.is_file():
            raise DataError(f"'{path}' is a device or a pipe; give a file")
    except OSError as error:
        raise DataError(f"cannot read '{path}': {error.strerror or error}") from None


def _neighbour(path: Path, known: Collection[str]) -> str:
    if not path.parent.is_dir():
        return f": there is no folder '{path.parent}'"
    with contextlib.suppress(OSError):  # a folder that may be entered but not listed
        names = [p.name for p in path.parent.iterdir() if p.suffix.lower() in known]
        return f": {nearest(path.name, names)}" if names else ""
    return ""


def _selected(time: Array, start: float | None, stop: float | None, where: str) -> slice:
    first = 0 if start is None else int(np.searchsorted(time, start))
    last = len(time) if stop is None else int(np.searchsorted(time, stop))
    if last - first < 2:
        raise DataError(
            f"{where}: fewer than 2 samples between start = {start} and stop = {stop} s; "
            f"the recording goes from {time[0]:.9g} to {time[-1]:.9g} s"
        )
    return slice(first, last)


def _spread(factors: Group, y: Group) -> Array:
    """Factors of all outputs: 1 where none is given."""
    given = dict(zip(factors.units, factors.values.T, strict=True))
    return np.stack([given.get(name, np.ones(len(y.values))) for name in y.units], axis=1)


def _group(signals: Mapping[str, Column], raw: Mapping[str, Array], kept: slice) -> Group:
    values = [c.physical(raw[c.name][kept]) for c in signals.values()]
    n = kept.stop - kept.start
    return Group(
        np.stack(values, axis=1) if values else np.empty((n, 0)),
        {name: c.unit for name, c in signals.items()},
    )
