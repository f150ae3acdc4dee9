"""Which reader takes a file, and what is said if it cannot be read."""

import contextlib
import dataclasses
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from backsight.data._kinds import TEXT, is_bag_folder, kind_of
from backsight.data._pick import list_arrays, pick
from backsight.data._request import Contents, Listed, Request, TextForm
from backsight.data._room import check_room
from backsight.data.formats._arrays import (
    list_containers,
    read_hdf5,
    read_netcdf,
    read_npy,
    read_npz,
)
from backsight.data.formats._matlab import list_mat, read_mat
from backsight.data.formats._tables import (
    frames_in,
    list_frames,
    list_xlsx,
    read_feather,
    read_parquet,
    read_xlsx,
)
from backsight.data.formats.recorders import (
    list_bag,
    list_hawc2,
    list_lvm,
    list_mcap,
    list_mdf,
    list_outb,
    list_tdms,
    list_uff,
    list_wav,
    read_bag,
    read_hawc2,
    read_lvm,
    read_mcap,
    read_mdf,
    read_outb,
    read_tdms,
    read_uff,
    read_wav,
)
from backsight.data.texts.reading import list_text, read_text
from backsight.errors import DataError, PluginError, nearest
from backsight.plugins import Extended
from backsight.types import Array

Reader: TypeAlias = Callable[[Path, Request], Contents]
"""What reads the files of a kind."""

CONTAINERS: Mapping[str, Reader] = {
    ".mat": read_mat,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".nc": read_netcdf,
    ".npz": read_npz,
    ".npy": read_npy,
}
"""Extension to reader of the files that hold named arrays."""

RECORDERS: Mapping[str, Reader] = {
    ".lvm": read_lvm,
    ".tdms": read_tdms,
    ".uff": read_uff,
    ".unv": read_uff,
    ".wav": read_wav,
    ".outb": read_outb,
    ".sel": read_hawc2,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    ".mcap": read_mcap,
    ".db3": read_bag,
    ".bag": read_bag,
    ".parquet": read_parquet,
    ".feather": read_feather,
    ".xlsx": read_xlsx,
}
"""Of recorders, simulators, robots and spreadsheets."""

Lister: TypeAlias = Callable[[Path, Request], Sequence[Listed]]
"""What says which columns a file holds."""

LISTERS: Mapping[str, Lister] = {
    **dict.fromkeys(TEXT, list_text),
    **dict.fromkeys(CONTAINERS, list_containers),
    ".mat": list_mat,
    ".lvm": list_lvm,
    ".tdms": list_tdms,
    ".uff": list_uff,
    ".unv": list_uff,
    ".wav": list_wav,
    ".outb": list_outb,
    ".sel": list_hawc2,
    ".mf4": list_mdf,
    ".mdf": list_mdf,
    ".mcap": list_mcap,
    ".db3": list_bag,
    ".bag": list_bag,
    ".parquet": list_frames,
    ".feather": list_frames,
    ".xlsx": list_xlsx,
}
"""Extension to lister, for all readers of ours."""

UNREADABLE = (OSError, ValueError, LookupError, EOFError, MemoryError)
"""What a sound reader may raise on files that are cut off or of another kind."""

ExtensionReader: TypeAlias = Callable[[Path, Sequence[str]], Mapping[str, Array]]
"""``(path, names of the wanted columns) -> {name: values}``, what an extension brings."""


def _adopted(key: str, found: object) -> Reader:
    """Somebody else's reader, which may return more columns than are wanted, and lists."""
    if not callable(found):
        raise DataError(f"it must be a function (path, wanted) -> columns by name, not {found!r}")

    def reader(path: Path, request: Request) -> Contents:
        columns = found(path, list(request.wanted))
        if not isinstance(columns, Mapping):
            raise DataError(f"the reader of '{key}' files returned no columns by name")
        arrays = {name: np.asarray(values) for name, values in columns.items()}
        # Where nothing is asked for, everything is listed.
        signals = [c.name for c in list_arrays(arrays, request.axis) if c.kind == "numbers"]
        return Contents(pick(arrays, request.wanted or signals, axis=request.axis))

    return reader


READERS = Extended(
    "backsight.readers",
    "reader",
    {**dict.fromkeys(TEXT, read_text), **CONTAINERS, **RECORDERS},
    _adopted,
    prefix=".",
)
"""Extension to reader: ours, and those of installed extensions (``rl2`` reads ``.rl2``)."""


def read_contents(path: Path, request: Request, wish: str | None) -> Contents:
    """Read what is wanted of a file; raises `DataError` or `PluginError`, which name it."""
    kind = _kind(path, request, wish)
    with _readable(path, kind):
        return READERS[kind](path, request)


def list_contents(path: Path, request: Request, wish: str | None) -> list[Listed]:
    """List the columns of a file; raises as `read_contents`.

    The reader of an extension is asked for no column: what it returns then is listed.
    """
    kind = _kind(path, request, wish)
    with _readable(path, kind):
        if kind in READERS.own:
            return list(LISTERS[kind](path, request))
        return list_arrays(READERS[kind](path, request).columns, request.axis)


def _kind(path: Path, request: Request, wish: str | None) -> str:
    _check_file(path, READERS)
    kind = kind_of(path, wish, READERS)
    if request.text != TextForm(missing=request.text.missing) and kind not in TEXT:
        option = next(
            f.name
            for f in dataclasses.fields(TextForm)
            if f.name != "missing" and getattr(request.text, f.name) != f.default
        )
        raise DataError(f"{path}: {option} is for text files, not for '{kind}'")
    return kind


@contextlib.contextmanager
def _readable(path: Path, kind: str) -> Iterator[None]:
    """Say what is wrong with a file, and whose reader is at fault."""
    try:
        if kind in TEXT:
            check_room(path.stat().st_size, "the file")
        with READERS.blamed(kind, but=UNREADABLE), warnings.catch_warnings():
            if kind in READERS.own:
                warnings.simplefilter("ignore")  # of libraries, about files that are cut off
            yield
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
            if not is_bag_folder(path) and not frames_in(path):
                raise DataError(f"'{path}' is a folder; give a file, or a folder of Parquet parts")
        elif not path.is_file():
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
