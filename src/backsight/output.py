"""Files and folders that are there whole or not at all."""

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from backsight.errors import OutputError


def write_whole(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file beside its place and rename it, so that nobody ever sees half of it.

    Parameters
    ----------
    path : path
        Where to; missing folders are made.
    content : bytes
        The whole file.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written; nothing is left behind then.
    """
    target = Path(path)
    part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            part.write_bytes(content)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"cannot write '{target}': {reason}; choose a place that can be written"
        ) from error
    return target


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
