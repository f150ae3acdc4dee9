"""Files that take the places of older ones: all of them or none, also if the process is killed.

What is to be moved lies in a folder of its own, a `part`, inside the folder where it shall be.
Before the first file moves a list is written. Its name says how far the move has come:

    READY -> DONE           files move to their places
    READY -> BACK -> UNDONE after an error, old files return to theirs

Whoever finds READY or BACK, and no living owner, does the rest. Nothing on the way back needs room
on the disk.
"""

import contextlib
import json
import os
import secrets
import shutil
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from backsight.output._disk import to_disk
from backsight.output._locking import HOLD, locked

PART = ".backsight-*.part"
"""Pattern of the names of parts."""

OWNER, KEPT = ".backsight-owner", ".backsight-kept"
"""In a part: that its owner has a lock; the folder of old files."""

READY, DONE, BACK, UNDONE = (f".backsight-{w}" for w in ("ready", "done", "back", "undone"))

INTERNAL = frozenset({OWNER, KEPT, READY, DONE, BACK, UNDONE})

_LARGEST_LIST = 1_000_000  # bytes


class _Listed(NamedTuple):
    """Names that move, and those of them in whose places there were files."""

    names: list[str]
    kept: list[str]


@contextlib.contextmanager
def part_in(folder: Path) -> Iterator[Path]:
    """Give a new part of a folder; at the end it is gone, unless a move was cut off."""
    with contextlib.ExitStack() as stack:
        while (part := _owned(folder, stack)) is None:
            pass
        try:
            yield part
        finally:
            if not any((part / state).exists() for state in (READY, BACK)):
                _clear(part)


def _owned(folder: Path, stack: contextlib.ExitStack) -> Path | None:
    """Make a part and lock it; None if another has tidied it up before it was locked."""
    part = folder / f".backsight-{secrets.token_hex(4)}.part"
    try:
        part.mkdir()
        lock = stack.enter_context(locked(part, wait=True))
        with contextlib.suppress(FileNotFoundError):
            if lock == "held":
                (part / OWNER).touch()
    except BaseException:
        _clear(part)
        raise
    return part if part.exists() else None


def is_moved(part: Path) -> bool:
    """Whether all that was in a part has come to its place."""
    return (part / DONE).exists() or not part.exists()


def exchange(names: Sequence[str], part: Path, target: Path) -> None:
    """Put files of a part in their places; after an error, put those back that were there."""
    there = [name for name in names if os.path.lexists(target / name)]
    listed = _Listed([*names], there)
    (part / KEPT).mkdir()
    for name in there:
        _second_name(target / name, part / KEPT / name)
    to_disk(part / KEPT)
    try:
        _note_down(part / READY, json.dumps(listed._asdict()))
        to_disk(part)
        _forward(listed, part, target)
        to_disk(target)
        (part / READY).rename(part / DONE)
    except BaseException:
        if (part / READY).exists():
            (part / READY).rename(part / BACK)
            to_disk(part)
            _back(listed, part, target)
            to_disk(target)
            (part / BACK).rename(part / UNDONE)
        raise


def settle(folder: Path) -> None:
    """Finish or undo what a process that was killed had begun in a folder, and clear it away."""
    if not folder.match(PART):
        (folder / OWNER).unlink(missing_ok=True)  # of a part that has become this folder
    for part in sorted(folder.glob(PART)):
        if not _is_own(part):
            continue
        with locked(part, wait=False) as lock:
            if lock != "held":
                continue  # somebody is at work, or nobody can tell
            if (part / OWNER).exists():
                _finish(part, folder)
            else:
                with contextlib.suppress(OSError):
                    part.rmdir()  # killed before it had an owner, or on a disk without locks


def tidy(folder: Path) -> None:
    """Clear away what processes that were killed have left in a folder that this one holds."""
    settle(folder)
    for rest in folder.glob(".*.part"):
        if not rest.is_dir():
            rest.unlink(missing_ok=True)


def folder_entries(folder: Path) -> list[str]:
    """Names in a folder, without locks and what is unfinished."""
    ours = {HOLD, *INTERNAL}
    unfinished = {path.name for path in folder.glob(PART)}
    return sorted({path.name for path in folder.iterdir()} - ours - unfinished)


def _is_own(part: Path) -> bool:
    """Whether this user made it: others could have files of ours replaced, in ``/tmp`` say."""
    about = part.lstat()
    mine = not hasattr(os, "geteuid") or about.st_uid == os.geteuid()
    return mine and stat.S_ISDIR(about.st_mode)


def _finish(part: Path, folder: Path) -> None:
    for state, move, end in ((READY, _forward, DONE), (BACK, _back, UNDONE)):
        if (part / state).exists():
            move(_listed_in(part / state), part, folder)
            to_disk(folder)
            (part / state).rename(part / end)
    _clear(part)


def _clear(part: Path) -> None:
    """Remove a part; its owner last, so that what is cut off here is found again."""
    with contextlib.suppress(OSError):
        for path in part.iterdir():
            if path.name != OWNER:
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    shutil.rmtree(part, ignore_errors=True)


def _note_down(path: Path, text: str) -> None:
    """Write a file that survives a power cut from then on."""
    with path.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _listed_in(path: Path) -> _Listed:
    """What a list says; nothing if it was not written to its end: nothing moved then."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        if path.stat().st_size <= _LARGEST_LIST:
            match json.loads(path.read_text(encoding="utf-8")):
                case {"names": [*names], "kept": [*kept]} if all(map(is_name, [*names, *kept])):
                    return _Listed(names, kept)
    return _Listed([], [])


def is_name(text: object) -> bool:
    """Whether it names a file in a folder, and nothing outside."""
    return isinstance(text, str) and text not in ("", ".", "..") and not set(text) & {*"/\\\0"}


def _forward(listed: _Listed, part: Path, target: Path) -> None:
    """Move what has not been moved; it may be called again after having been cut off."""
    for name in listed.names:
        if os.path.lexists(part / name):
            (part / name).replace(target / name)


def _back(listed: _Listed, part: Path, target: Path) -> None:
    """Bring back the old files; it may be called again after having been cut off."""
    for name in listed.kept:
        if os.path.lexists(part / KEPT / name):
            (part / KEPT / name).replace(target / name)
    for name in listed.names:
        if name not in listed.kept and not os.path.lexists(part / name):
            (target / name).unlink(missing_ok=True)


def _second_name(path: Path, other: Path) -> None:
    """Give a file another name, by a copy where the disk has no links."""
    try:
        os.link(path, other, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(path, other, follow_symlinks=False)
