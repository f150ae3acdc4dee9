"""Files and folders that are there whole or not at all, and that replace nothing of others.

A folder that was written here holds a marker with the names of the files. Only these are replaced
the next time; what else has such a name was made by somebody, and is named instead of lost.
"""

import contextlib
import importlib.metadata
import json
import os
import secrets
import shutil
import stat
from collections.abc import Collection, Iterator
from pathlib import Path

from backsight.errors import OutputError
from backsight.output._moving import INTERNAL, OWNER, exchange, is_name, owned, settle

MARKER = ".backsight.json"
"""Names of the files in a folder that may be replaced."""

HOLD = ".lock"
"""File in a folder to which one process at a time writes."""

_LARGEST_MARKER = 1_000_000  # bytes


def write_whole(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file beside its place and rename it, so that nobody ever sees half of it.

    Parameters
    ----------
    path : path
        Where to; missing folders are made. A file that is there is replaced; of a link, the link.
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
            _to_disk(part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"cannot write '{target}': {reason}; choose a place that can be written"
        ) from error
    return target


def put_in_place(part: Path, target: Path) -> None:
    """Move a file that was written beside its place there; it survives a power cut then."""
    _to_disk(part)
    part.replace(target)
    _to_disk(target.parent)


@contextlib.contextmanager
def whole(
    out: str | os.PathLike[str], *, names: Collection[str] | None = None, force: bool = False
) -> Iterator[Path]:
    """Give a folder to write into; its files move to `out` when the block ends without an error.

    Whether `out` can be written, and would lose nothing, is known before the block begins. After an
    error or an interrupt nothing is left behind. If the process is killed while files move, the
    next one that writes to the folder finishes that first.

    Parameters
    ----------
    out : path
        Folder; missing ones are made. Files of the same name are replaced if they are from an
        earlier call, others stay.
    names : collection of str, optional
        The files that will be written. If that is not known, a folder in which there is anything
        but the results of earlier calls is refused.
    force : bool
        Replace files of the same name whoever made them.

    Raises
    ------
    OutputError
        If `out` cannot be written, or files that are not from an earlier call would be replaced.
    """
    target = Path(out)
    # A neighbour on the same disk: moving a file there is one step.
    there = next(p for p in (target, *target.absolute().parents) if p.exists())
    with writing(target):
        settle(there)
    _check_free(target, names, force=force)
    part = there / f".backsight-{secrets.token_hex(4)}.part"
    with writing(target):
        part.mkdir()
    try:
        with owned(part):
            yield part
            with writing(target):
                for name in _in(part):
                    _to_disk(part / name)
                _publish(part, target, force=force)
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


def _publish(part: Path, target: Path, *, force: bool) -> None:
    """Move the files, all of them or none."""
    names = _in(part)
    if not target.exists():
        # The new folder appears with all that is in it.
        (part / MARKER).write_text(_marked(names), encoding="utf-8")
        target.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(OSError):  # another process was faster
            part.rename(target)
            (target / OWNER).unlink(missing_ok=True)
            return _to_disk(target.parent)
    target.mkdir(exist_ok=True)
    with _alone(target):
        own = _own(target)
        _check_free(target, names, force=force)
        # The marker goes first: whatever happens, the files are known for what they are.
        (part / MARKER).write_text(_marked([*own, *names]), encoding="utf-8")
        exchange(list(dict.fromkeys([MARKER, *names])), part, target)
        _to_disk(target)
    return None


def _in(part: Path) -> list[str]:
    """Names of what was written into a part."""
    return sorted({file.name for file in part.iterdir()} - INTERNAL)


def _check_free(target: Path, names: Collection[str] | None, *, force: bool) -> None:
    """Raise `OutputError` if a file would be replaced that was not written here."""
    with writing(target):
        if not target.is_dir():
            return
        own = _own(target)
        if names is None:
            there = sorted(p.name for p in target.iterdir() if not _unfinished(p.name))
            names = [] if own or force else there
        taken = [n for n in [*names, MARKER] if os.path.lexists(target / n)]
        folders = [n for n in taken if (target / n).is_dir() and not (target / n).is_symlink()]
    foreign = [n for n in taken if n not in own]
    if foreign and not force:
        raise OutputError(
            f"'{target}' has files that are not from here and would be replaced: "
            f"{_listed(foreign)}; choose another folder, or replace them: --force (force=True)"
        )
    if folders:
        raise OutputError(f"'{target}' has a folder {_listed(folders)}; choose another place")


def _own(target: Path) -> list[str]:
    """Names in the marker, and its own; none if there is no marker or it is none."""
    path = target / MARKER
    try:
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode) or found.st_size > _LARGEST_MARKER:
            return []
        match json.loads(path.read_text(encoding="utf-8")):
            case {"program": "backsight", "files": [*files]}:
                return [MARKER, *(n for n in files if isinstance(n, str) and is_name(n))]
    except (OSError, ValueError, RecursionError):
        pass
    return []


def _marked(names: Collection[str]) -> str:
    files = sorted(set(names) - {MARKER})
    about = {"program": "backsight", "version": importlib.metadata.version("backsight")}
    return json.dumps({**about, "files": files}, indent=1) + "\n"


def _unfinished(name: str) -> bool:
    return name.startswith(".backsight-") and name.endswith(".part")


def _listed(names: Collection[str]) -> str:
    first = ", ".join([ascii(n)[1:-1] if not n.isprintable() else n for n in names][:8])
    return f"{first} and {len(names) - 8} more" if len(names) > 8 else first


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process after the other move its files in, where the system can do that."""
    if os.name == "nt":
        yield
        return
    import fcntl

    number = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some disks of a network have no locks
            fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)


@contextlib.contextmanager
def holding(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; it goes with the process, however that ends.

    Raises
    ------
    OutputError
        If another process holds it, or the folder cannot be written.
    """
    if os.name == "nt":
        yield
        return
    import fcntl

    with writing(folder):
        number = os.open(folder / HOLD, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"another process writes to '{folder}'; wait for it") from None
        yield
    finally:
        os.close(number)


def _to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, would survive a power cut."""
    if path.is_dir() and os.name == "nt":
        return
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)
