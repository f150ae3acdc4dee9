"""What nobody but the user can have written: folders and files of their own, and a secret key.

Machine code that is loaded from a disk is as good as whoever could write there. On POSIX, owner and
mode tell who could; on Windows the user's folders are private by their access lists.
"""

import contextlib
import os
import secrets
import stat
import sys
from pathlib import Path

KEY_BYTES = 32


class NotPrivateError(Exception):
    """Others own or may write to something that only the user should; the message says what."""


def check_private(path: Path, *, secret: bool = False) -> None:
    """Raise `NotPrivateError` if another user may have written a file or to a folder.

    A folder in which nobody may touch the files of others (mode 1777, such as ``/tmp``) is fine:
    what is in it is looked at by itself. A `secret` must not be readable for others either.
    """
    if not hasattr(os, "geteuid"):
        return
    found = path.stat()
    if found.st_uid not in (os.geteuid(), 0):
        raise NotPrivateError(f"'{path}' belongs to another user")
    rights = stat.S_IRWXG | stat.S_IRWXO if secret else stat.S_IWGRP | stat.S_IWOTH
    apart = stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX
    if found.st_mode & rights and not apart:
        what, remedy = ("read", "go=") if secret else ("changed", "go-w")
        raise NotPrivateError(f"'{path}' can be {what} by others; mend that with chmod {remedy}")


def key() -> bytes:
    """Return the secret key of this user, made at random when it is first needed.

    Raises
    ------
    NotPrivateError
        If others may have read or written it.
    OSError, RuntimeError
        If there is no place for it, or no home folder.
    """
    path = _place() / "cache-key-1"
    found = _read(path)
    return found if found is not None else _made(path)


def _place() -> Path:
    """Where programs keep what belongs to one user on one computer."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Application Support"
    else:
        base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "backsight"


def _read(path: Path) -> bytes | None:
    """The key, or None if there is none."""
    try:
        with path.open("rb") as file:
            content = file.read(KEY_BYTES + 1)
    except FileNotFoundError:
        return None
    check_private(path.parent)
    check_private(path, secret=True)
    return content if len(content) == KEY_BYTES else None


def _made(path: Path) -> bytes:
    """Make the key; of several processes that do so at once, one wins for all."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    check_private(path.parent)
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    made = secrets.token_bytes(KEY_BYTES)
    number = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(made)
            file.flush()
            os.fsync(file.fileno())
        with contextlib.suppress(FileExistsError):
            os.link(part, path)  # unlike a rename it never replaces the key of another process
        found = _read(path)
        if found is not None:
            return found
        os.replace(part, path)  # what lies there is no key
        return made
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(part)
