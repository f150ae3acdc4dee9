"""Compiled programs on disk, so that each is compiled only once.

A file that cannot be read, is damaged or cannot be written is no error: the program is then
compiled again.
"""

import contextlib
import hashlib
import os
import sys
import tempfile
from pathlib import Path

KEEP = 500
"""Number of files kept; the ones not used for the longest time are removed."""

_DIGEST = hashlib.sha256().digest_size


def folder() -> Path:
    """Return the folder: ``BACKSIGHT_CACHE`` or the user's place for such files."""
    chosen = os.environ.get("BACKSIGHT_CACHE")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "backsight"


def read(name: str) -> bytes | None:
    """Return what was kept under a name, or None if there is nothing whole."""
    path = folder() / name
    try:
        content = path.read_bytes()
    except OSError:
        return None
    body = content[_DIGEST:]
    if hashlib.sha256(body).digest() != content[:_DIGEST]:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return body


def keep(name: str, body: bytes) -> None:
    """Keep a content under a name; other processes see all of it or nothing."""
    with contextlib.suppress(OSError):
        place = folder()
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        number, temporary = tempfile.mkstemp(dir=place, suffix=".tmp")
        try:
            with os.fdopen(number, "wb") as file:
                file.write(hashlib.sha256(body).digest() + body)
            os.replace(temporary, place / name)
        except BaseException:
            os.unlink(temporary)
            raise
        _remove_oldest(place)


def _remove_oldest(place: Path) -> None:
    files = [entry for entry in os.scandir(place) if entry.is_file()]
    oldest = sorted(files, key=lambda entry: entry.stat().st_mtime)
    for entry in oldest[: max(len(files) - KEEP, 0)]:
        os.unlink(entry.path)
