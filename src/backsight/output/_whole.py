"""Files and folders that are there whole or not at all, and that replace nothing of others.

A folder that was written here holds a marker with the names of the files. Only these are replaced
the next time; what else has such a name was made by somebody, and is named instead of lost.
"""

import contextlib
import functools
import importlib.metadata
import json
import os
import stat
from collections.abc import Collection, Iterator
from pathlib import Path

from backsight.errors import OutputError
from backsight.output._disk import make_folder, put_in_place, to_disk, writing
from backsight.output._locking import locked
from backsight.output._moving import (
    INTERNAL,
    OWNER,
    exchange,
    folder_entries,
    is_moved,
    is_name,
    part_in,
    settle,
)

MARKER = ".backsight.json"
"""Names of the files in a folder that may be replaced."""

NOTHING = "nothing is written"

_LARGEST_MARKER = 1_000_000  # bytes


def write_whole(
    path: str | os.PathLike[str], content: bytes, *, replace: bool = True, mode: int = 0o666
) -> Path:
    """Write a file beside its place and rename it, so that nobody ever sees half of it.

    Parameters
    ----------
    path : path
        Where to; missing folders are made. A file that is there is replaced; of a link, the link.
    content : bytes
        The whole file.
    replace : bool
        Whether a file that is there is replaced; it is an error otherwise.
    mode : int
        Who may read and write it, without what the user's mask forbids.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    OutputError
        If the file cannot be written, or is there already; nothing is left behind then.
    """
    target = Path(path)
    try:
        make_folder(target.parent)
        settle(target.parent)
        with part_in(target.parent) as part:
            number = os.open(part / target.name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with os.fdopen(number, "wb") as file:
                file.write(content)
            if not replace:
                _link_in_place(part / target.name, target)
            put_in_place(part / target.name, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"cannot write '{target}': {reason}; choose a place that can be written"
        ) from error
    return target


def _link_in_place(part: Path, target: Path) -> None:
    """Give a file its name, which nobody must have yet; moving it there changes nothing then."""
    to_disk(part)
    try:
        os.link(part, target)
    except FileExistsError:
        raise _taken(target) from None
    except OSError:  # a disk without links
        if os.path.lexists(target):
            raise _taken(target) from None


def _taken(target: Path) -> OutputError:
    return OutputError(f"'{target}' is there already; nothing is overwritten, name another")


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
    with contextlib.ExitStack() as stack:
        with writing(target):
            part = stack.enter_context(part_in(there))
        try:
            yield part
            with writing(target):
                for name in _in(part):
                    to_disk(part / name)
                _publish(part, target, force=force)
        except OSError as error:
            if error.filename and not Path(str(error.filename)).is_relative_to(part):
                raise
            with writing(target):
                raise
        except KeyboardInterrupt as interrupt:
            # The outermost folder is what the user knows.
            interrupt.__notes__ = ["the results are written" if is_moved(part) else NOTHING]
            raise


def _publish(part: Path, target: Path, *, force: bool) -> None:
    """Move the files, all of them or none."""
    names = _in(part)
    if not target.exists():
        # The new folder appears with all that is in it.
        _mark(part, names)
        make_folder(target.parent)
        with contextlib.suppress(OSError):  # another process was faster
            return _appear(part, target)
    make_folder(target)
    with locked(target, wait=True):
        own = _own(target)
        _check_free(target, names, force=force)
        # The marker goes first: whatever happens, the files are known for what they are.
        _mark(part, [*own, *names])
        exchange(list(dict.fromkeys([MARKER, *names])), part, target)
    return None


def _appear(part: Path, target: Path) -> None:
    """Make a folder of a part."""
    to_disk(part)
    part.rename(target)
    try:
        to_disk(target.parent)
    except BaseException:
        target.rename(part)
        raise
    with contextlib.suppress(OSError):
        (target / OWNER).unlink(missing_ok=True)


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
            names = [] if own or force else folder_entries(target)
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
                return [MARKER, *filter(is_name, files)]
    except (OSError, ValueError, RecursionError):
        pass
    return []


@functools.cache
def _version() -> str:
    return importlib.metadata.version("backsight")


def _mark(part: Path, names: Collection[str]) -> None:
    files = sorted(set(names) - {MARKER})
    about = {"program": "backsight", "version": _version(), "files": files}
    text = json.dumps(about, indent=1) + "\n"
    (part / MARKER).write_text(text, encoding="utf-8")
    to_disk(part / MARKER)


def _listed(names: Collection[str]) -> str:
    first = ", ".join([ascii(n)[1:-1] if not n.isprintable() else n for n in names][:8])
    return f"{first} and {len(names) - 8} more" if len(names) > 8 else first
