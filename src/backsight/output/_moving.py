"""Files that take the places of older ones: all of them or none, also if the process is killed.

What is to be moved lies in a folder of its own, a `part`, inside the folder where it shall be.
Before the first file moves a list is written; whoever finds it after a kill, and no living owner,
moves what is left, or brings back the old files where that had been begun.
"""

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

OWNER, READY, BACK, KEPT, AGAIN = (
    f".backsight-{word}" for word in ("owner", "ready", "back", "kept", "again")
)
"""In a part: that its owner has a lock; the list; that files go back; old files; one on its way."""

INTERNAL = frozenset({OWNER, READY, BACK, KEPT, AGAIN})

_LARGEST_LIST = 1_000_000  # bytes


@contextlib.contextmanager
def owned(part: Path) -> Iterator[None]:
    """Hold the lock of a part, which goes with the process, however that ends."""
    number = _locked(part)
    try:
        if number is not None:
            (part / OWNER).touch()
        yield
    finally:
        if number is not None:
            os.close(number)


def exchange(names: Sequence[str], part: Path, target: Path) -> None:
    """Put files of a part in their places; after an error, put those back that were there."""
    kept = part / KEPT
    kept.mkdir()
    for name in names:
        if os.path.lexists(target / name):
            _second_name(target / name, kept / name)
    note_down(part / READY, json.dumps(list(names)))
    try:
        _forward(names, part, target)
    except BaseException:
        note_down(part / BACK, "")
        _back(names, part, target)
        raise


def settle(folder: Path) -> None:
    """Finish or undo what a process that was killed had begun in a folder, and clear it away."""
    for part in sorted(folder.glob(".backsight-*.part")):
        if part.is_symlink() or not (part / OWNER).exists():
            continue
        number = _locked(part)
        if number is None:
            continue  # somebody is at work, or nobody can tell
        try:
            names = _listed_in(part)
            (_back if (part / BACK).exists() else _forward)(names, part, folder)
            shutil.rmtree(part, ignore_errors=True)
        finally:
            os.close(number)


def note_down(path: Path, text: str) -> None:
    """Write a file that survives a power cut from then on."""
    with path.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def _listed_in(part: Path) -> list[str]:
    """Names in the list of a part; none if it was not written to its end: nothing moved then."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        if (part / READY).stat().st_size <= _LARGEST_LIST:
            found = json.loads((part / READY).read_text(encoding="utf-8"))
            if isinstance(found, list) and all(isinstance(n, str) and is_name(n) for n in found):
                return found
    return []


def is_name(text: str) -> bool:
    """Whether it names a file in a folder, and nothing outside."""
    return text not in ("", ".", "..") and not set(text) & {"/", "\\", "\0"}


def _forward(names: Sequence[str], part: Path, target: Path) -> None:
    """Move what has not been moved; it may be called again after having been cut off."""
    for name in names:
        if os.path.lexists(part / name):
            (part / name).replace(target / name)


def _back(names: Sequence[str], part: Path, target: Path) -> None:
    """Bring back the old files; it may be called again after having been cut off."""
    for name in reversed(names):
        if os.path.lexists(part / KEPT / name):
            (part / AGAIN).unlink(missing_ok=True)
            _second_name(part / KEPT / name, part / AGAIN)
            (part / AGAIN).replace(target / name)
        elif not os.path.lexists(part / name):
            (target / name).unlink(missing_ok=True)


def _second_name(path: Path, other: Path) -> None:
    """Give a file another name, by a copy where the disk has no links."""
    try:
        os.link(path, other, follow_symlinks=False)
    except (OSError, NotImplementedError):
        shutil.copy2(path, other, follow_symlinks=False)


def _locked(folder: Path) -> int | None:
    """Lock a folder; None if somebody else has it, or the system or the disk has no locks."""
    if os.name == "nt":
        return None
    import fcntl

    try:
        number = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(number)
        return None
    return number
