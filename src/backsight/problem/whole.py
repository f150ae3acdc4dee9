"""A folder of files that are there together or not at all."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from backsight.errors import OutputError


@contextlib.contextmanager
def whole(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a folder to write into; its files move to `out` when the block ends without an error.

    Whether `out` can be written is known before the block begins. After an error or an interrupt
    nothing is left behind.

    Parameters
    ----------
    out : path
        Folder; missing ones are made, files of the same name are replaced.

    Raises
    ------
    OutputError
        If `out` cannot be written.
    """
    target = Path(out)
    # A neighbour on the same disk: moving a file there is one step.
    there = next(p for p in (target, *target.absolute().parents) if p.exists())
    part = there / f".backsight-{secrets.token_hex(4)}.part"
    with writing(target):
        part.mkdir()
    try:
        yield part
        with writing(target):
            target.mkdir(parents=True, exist_ok=True)
            for file in sorted(part.iterdir()):
                file.replace(target / file.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextlib.contextmanager
def writing(target: Path) -> Iterator[None]:
    """Turn what the file system refuses into an `OutputError` that names the folder."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"cannot write to the folder '{target}': {reason}; choose another one"
        ) from error
