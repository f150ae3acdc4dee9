"""What survives a power cut: contents and names that the disk has confirmed."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from backsight.errors import OutputError

_NOT_OFFERED = {errno.EINVAL, errno.ENOTSUP, errno.EBADF, errno.EACCES, errno.EPERM}
"""How file systems say that they do not confirm names of a folder, or that it may not be read."""


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, would survive a power cut."""
    if not path.is_dir():
        return _confirmed(path, os.O_RDWR)
    if os.name != "nt":
        try:
            _confirmed(path, os.O_RDONLY)
        except OSError as error:
            if error.errno not in _NOT_OFFERED:
                raise
    return None


def _confirmed(path: Path, flags: int) -> None:
    number = os.open(path, flags)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, so that they survive a power cut."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        to_disk(path.parent)


def put_in_place(part: Path, target: Path) -> None:
    """Move a file that was written on the same disk to its place; it survives a power cut then."""
    to_disk(part)
    part.replace(target)
    to_disk(target.parent)


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
