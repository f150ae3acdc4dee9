"""The recordings of a fleet, from patterns or a table with what is known of each."""

import dataclasses
import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backsight.errors import ProblemError, nearest
from backsight.fleet._changes import Changes, names_file
from backsight.fleet._tables import RecordingsTable
from backsight.problem.recorded import expanded

if TYPE_CHECKING:
    import pandas as pd

MOST_BYTES = 500_000_000
"""Largest table of recordings."""

Stamp = tuple[int, int]
"""Size and time of the last change [ns]."""


@dataclasses.dataclass(frozen=True)
class FleetRecording:
    """A recording of a fleet.

    Parameters
    ----------
    name : str
        Its path from the folder of the fleet file.
    path : str
        The file.
    changes : tuple of (key, value)
        Keys of the problem file that have a value of its own; the path is not among them.
    metadata : dict
        What the table says of it beside.
    """

    name: str
    path: str
    changes: Changes = ()
    metadata: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def at(cls, path: Path, folder: Path, **known: Any) -> "FleetRecording":
        """A recording by its path; `folder` is that of the fleet file."""
        inside = path.is_relative_to(folder)
        return cls((path.relative_to(folder) if inside else path).as_posix(), str(path), **known)

    @property
    def files(self) -> tuple[str, ...]:
        """All files of its own."""
        return self.path, *(str(v) for k, v in self.changes if names_file(k))

    def stamp(self) -> tuple[Stamp, ...]:
        """By what its files are known again without reading them; empty if one is not there."""
        try:
            about = [os.stat(file) for file in self.files]
        except OSError:
            return ()
        return tuple((a.st_size, a.st_mtime_ns) for a in about)


def listed_in(
    file: Path, table: RecordingsTable, folder: Path, env: Collection[str]
) -> list[FleetRecording]:
    """Recordings of a table.

    Raises
    ------
    ProblemError
        If the table cannot be read, lacks a column, or names a recording twice.
    """
    frame = _read(file)
    for key, column in {"file": table.file, **table.settings}.items():
        if column not in frame.columns:
            hint = nearest(column, map(str, frame.columns))
            raise ProblemError(
                f"recordings.{'file' if key == 'file' else f'settings.{key}'}: {file.name} has no "
                f"column '{column}', {hint}"
            )
    used = {table.file, *table.settings.values()}
    others = [str(c) for c in frame.columns if c not in used]
    columns = {str(c): _plain(frame[c].tolist()) for c in frame.columns}
    found = []
    for k, name in enumerate(columns[table.file]):
        if not isinstance(name, str) or not name:
            raise ProblemError(
                f"recordings.table: row {k + 1} of {file.name} has no '{table.file}'"
            )
        changes = tuple(
            (key, _value(key, columns[column][k], folder, env))
            for key, column in table.settings.items()
            if columns[column][k] is not None
        )
        path = folder / expanded(name, f"recordings.table, row {k + 1}", env=env)
        metadata = {c: columns[c][k] for c in others}
        found.append(FleetRecording.at(path, folder, changes=changes, metadata=metadata))
    _check_once(found, file)
    return found


def _value(key: str, value: Any, folder: Path, env: Collection[str]) -> Any:
    """A setting; paths are from the folder of the fleet file, like that of the recording."""
    if not names_file(key):
        return value
    return str(folder / expanded(str(value), f"recordings.settings.{key}", env=env))


def _check_once(found: Sequence[FleetRecording], file: Path) -> None:
    seen: set[tuple[str, Changes]] = set()
    for k, one in enumerate(found):
        if (one.name, one.changes) in seen:
            raise ProblemError(
                f"recordings.table: row {k + 1} of {file.name} is '{one.name}' with the same "
                "settings once more"
            )
        seen.add((one.name, one.changes))


def _read(file: Path) -> "pd.DataFrame":
    import pandas as pd

    try:
        if file.stat().st_size > MOST_BYTES:
            raise ProblemError(f"recordings.table: '{file}' is larger than {MOST_BYTES} bytes")
        match file.suffix.lower():
            case ".parquet":
                return pd.read_parquet(file)
            case ".xlsx":
                return pd.read_excel(file)
        with file.open(encoding="utf-8-sig") as text:
            first = text.readline()
        # Not pandas' own guess, which takes a letter where there is one column.
        separator = max(",;\t|", key=first.count)
        return pd.read_csv(file, sep=separator, encoding="utf-8-sig")
    except (OSError, ValueError, ImportError, pd.errors.ParserError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ProblemError(f"recordings.table: cannot read '{file}': {reason}") from None
    except Exception as error:  # of the libraries, as a zip that is none
        raise ProblemError(f"recordings.table: cannot read '{file}': {error}") from None


def _plain(values: Sequence[Any]) -> list[Any]:
    """Numbers and texts as JSON knows them; None where there is nothing, dates as texts."""
    return [_single(v) for v in values]


def _single(value: Any) -> Any:
    match value:
        case bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else None
    text = "" if value is None else str(value)
    return None if text in ("", "NaT", "<NA>", "None", "nan") else text
