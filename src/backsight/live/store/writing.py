"""Results as they come, in a folder of Parquet files: appended to, and never half written.

A part holds samples and, in its metadata, the memory of the estimator after them: both are there or
neither, since one rename makes them appear. A run that is killed goes on from its newest part.
Names that begin with a dot are no parts; pandas, Arrow and `backsight.read` take the folder as one
table, also while it is written.
"""

import base64
import contextlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from backsight.errors import OutputError, PluginError
from backsight.live.engine import Checkpoint
from backsight.output import holding, make_folder, put_in_place, tidy, write_whole, writing

_ABOUT, _KEY = ".about.json", b"backsight"
_FORM: Mapping[str, Any] = {"compression": "zstd", "use_dictionary": False}
"""Measured numbers hardly repeat: a dictionary of them costs time and saves nothing."""

_PART = re.compile(r"part-(\d{15})\.parquet")


class LiveStore:
    """A folder of parts, see `opened_live_store`."""

    def __init__(self, folder: Path, arrow: Any, parquet: Any) -> None:
        self.folder, self._arrow, self._parquet = folder, arrow, parquet

    def parts(self) -> list[Path]:
        """Parts in the order of time."""
        found = [p for p in self.folder.iterdir() if _PART.fullmatch(p.name)]
        return sorted(found)

    def checkpoint(self) -> tuple[Checkpoint, Mapping[str, np.ndarray]] | None:
        """The memory after the newest part, None if there is no part.

        Raises
        ------
        OutputError
            If it cannot be read.
        """
        parts = self.parts()
        if not parts:
            return None
        try:
            kept = self._parquet.read_metadata(parts[-1]).metadata[_KEY]
            return Checkpoint.unpacked(base64.b64decode(kept))
        except Exception as error:  # of whatever the disk returns
            raise OutputError(
                f"'{parts[-1]}' is damaged: {str(error).partition(chr(10))[0]}; move it away to go "
                "on from the part before"
            ) from None

    def columns(self, part: Path) -> dict[str, np.ndarray]:
        """Columns of a part by name; none if it was removed meanwhile or cannot be read."""
        try:
            table = self._parquet.read_table(part)
        except (OSError, self._arrow.ArrowException):
            return {}
        return {name: table[name].to_numpy() for name in table.column_names}

    def add(
        self, start: int, columns: Mapping[str, np.ndarray], units: Mapping[str, str], memory: bytes
    ) -> None:
        """Append a part whose first sample is that of slot `start`.

        Raises
        ------
        OutputError
            If it cannot be written; nothing is left behind then.
        """
        arrow = self._arrow
        fields = [
            arrow.field(name, arrow.from_numpy_dtype(values.dtype), metadata=_unit(units.get(name)))
            for name, values in columns.items()
        ]
        schema = arrow.schema(fields)
        # From memory as it is; `arrow.array` would import pandas to see whether these are series.
        memories = [(len(v), arrow.py_buffer(np.ascontiguousarray(v))) for v in columns.values()]
        arrays = [
            arrow.Array.from_buffers(field.type, n, [None, buffer])
            for field, (n, buffer) in zip(fields, memories, strict=True)
        ]
        table = arrow.Table.from_arrays(arrays, schema=schema)
        target = self.folder / f"part-{start:015d}.parquet"
        part = self.folder / f".{target.name}.part"
        with writing(self.folder):
            try:
                with (
                    part.open("wb") as file,
                    self._parquet.ParquetWriter(file, schema, **_FORM) as writer,
                ):
                    writer.write_table(table)
                    writer.add_key_value_metadata({_KEY: base64.b64encode(memory)})
                put_in_place(part, target)
            finally:
                part.unlink(missing_ok=True)

    def thin_out(self, *, before: float | None, largest: int | None, now: float) -> int:
        """Remove the oldest parts, but never the newest; how many were removed.

        Parameters
        ----------
        before : float, optional
            Age in seconds from which on parts go.
        largest : int, optional
            Bytes of all parts at most.
        now : float
            Seconds since 1970.
        """
        parts = self.parts()
        sizes = [p.stat() for p in parts]
        total, removed = sum(s.st_size for s in sizes), 0
        for part, about in zip(parts[:-1], sizes, strict=False):
            old = before is not None and now - about.st_mtime > before
            if not old and (largest is None or total <= largest):
                break
            with writing(self.folder):
                part.unlink()
            total -= about.st_size
            removed += 1
        return removed


def _unit(unit: str | None) -> dict[str, str] | None:
    return {"unit": unit} if unit else None


def arrow() -> Any:
    """The library that writes Parquet.

    Raises
    ------
    PluginError
        If it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError:
        raise PluginError("a store needs pyarrow: pip install 'backsight[live]'") from None
    return pyarrow


@contextlib.contextmanager
def opened_live_store(folder: Path, *, said: str) -> Iterator[LiveStore]:
    """Open a folder for appending, alone.

    Parameters
    ----------
    folder : Path
        Missing ones are made.
    said : str
        Digest of what is estimated; a folder of something else is refused.

    Raises
    ------
    OutputError
        If another process writes to it, it holds something else, or it cannot be written.
    PluginError
        If Arrow is not installed.
    """
    library = arrow()
    with writing(folder):
        make_folder(folder)
    with holding(folder):
        about = folder / _ABOUT
        if about.exists():
            _check_about(about, said)
        else:
            foreign = sorted(p.name for p in folder.iterdir() if not p.name.startswith("."))
            if foreign:
                raise OutputError(
                    f"'{folder}' has files that are not from here, such as {foreign[0]}; choose "
                    "another folder"
                )
            content = {"program": "backsight live", "of": said}
            write_whole(about, json.dumps(content, indent=1).encode())
        with writing(folder):
            tidy(folder)
        yield LiveStore(folder, library, library.parquet)


def _check_about(about: Path, said: str) -> None:
    try:
        found = json.loads(about.read_text(encoding="utf-8"))["of"]
    except (OSError, ValueError, KeyError, TypeError):
        raise OutputError(f"'{about}' is not from here; choose another folder") from None
    if found != said:
        raise OutputError(
            f"'{about.parent}' holds results of another estimator, model or sampling period; "
            "choose another folder, or move it away"
        )
