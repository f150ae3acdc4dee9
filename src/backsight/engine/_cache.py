"""Compiled programs on disk, so that each is compiled only once.

They are machine code: what is loaded here runs with all rights of the user. So files are taken only
from a folder that nobody else can write to, and only with a digest that nobody without the user's
secret key can make. A file that cannot be read, is damaged or cannot be written is no error: the
program is then compiled again. Everything else in the folder that the user chose is left alone.
"""

import contextlib
import functools
import hmac
import os
import re
import secrets
import sys
import time
import warnings
from pathlib import Path

from backsight.engine import _private as private
from backsight.errors import BacksightWarning

KEEP = 500
"""Number of files kept; a tenth more, and those not used for the longest time are removed."""

OWN = "backsight-code-1"
"""Folder inside the chosen one; the number changes with the form of the files."""

_MAGIC = b"Backsight code 1\n"
_DIGEST = 32
_NAME = re.compile(r"\w+", re.ASCII)
_PART = re.compile(r"\.\w+\.[0-9a-f]{8}\.tmp", re.ASCII)
_FORGOTTEN = 86400.0  # s; a file that is still being written is younger


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


def read_kept(name: str) -> bytes | None:
    """Return what was kept under a name, or None if there is nothing whole of the user's own."""
    try:
        trusted = _trusted(folder())
        if trusted is None:
            return None
        place, key = trusted
        path = place / name
        content = path.read_bytes()
        private.check_private(path)
    except (OSError, RuntimeError):
        return None
    except private.NotPrivateError as reason:
        _say(str(reason))
        return None
    head, body = content[: len(_MAGIC) + _DIGEST], content[len(_MAGIC) + _DIGEST :]
    if not hmac.compare_digest(head, _MAGIC + _digest(key, name, body)):
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return body


def keep(name: str, body: bytes) -> None:
    """Keep a content under a name; other processes see all of it or nothing."""
    with contextlib.suppress(OSError, RuntimeError):
        trusted = _trusted(folder())
        if trusted is None:
            return
        place, key = trusted
        part = place / f".{name}.{secrets.token_hex(4)}.tmp"
        number = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(number, "wb") as file:
                file.write(_MAGIC + _digest(key, name, body) + body)
            os.replace(part, place / name)
        except BaseException:
            os.unlink(part)
            raise
        _remove_oldest(place)


def _trusted(chosen: Path) -> tuple[Path, bytes] | None:
    """The folder for programs and the user's key, or None, said once, if others could interfere.

    Raises `OSError` or `RuntimeError` if there is no folder and none can be made.
    """
    place = chosen / OWN
    try:
        for path in (chosen, place):
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            private.check_private(path)
    except private.NotPrivateError as reason:
        _say(str(reason))
        return None
    try:
        return place, _key()
    except private.NotPrivateError as reason:
        _say(str(reason))
    except (OSError, RuntimeError) as reason:
        _say(f"there is no private place for a key ({reason})")
    return None


@functools.cache
def _key() -> bytes:
    return private.key()


def _digest(key: bytes, name: str, body: bytes) -> bytes:
    """With the name, so that a file does not pass for another one."""
    made = hmac.new(key, f"{name}\n".encode(), "sha256")
    made.update(body)
    return made.digest()


@functools.cache
def _say(reason: str) -> None:
    warnings.warn(
        f"compiled programs are not kept, so that every start takes longer: {reason}; "
        "BACKSIGHT_CACHE chooses another folder",
        BacksightWarning,
        stacklevel=2,
    )


def _remove_oldest(place: Path) -> None:
    files = [entry for entry in os.scandir(place) if entry.is_file(follow_symlinks=False)]
    own = [entry for entry in files if _NAME.fullmatch(entry.name)]
    # To ask for the times of so many files takes longer than to write one: not every time.
    if len(own) > KEEP + KEEP // 10:
        oldest = sorted(own, key=lambda entry: entry.stat().st_mtime)
        for entry in oldest[: len(own) - KEEP]:
            if _is_own(entry.path):
                os.unlink(entry.path)
    for entry in files:
        if _PART.fullmatch(entry.name) and time.time() - entry.stat().st_mtime > _FORGOTTEN:
            os.unlink(entry.path)


def _is_own(path: str) -> bool:
    with open(path, "rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC
