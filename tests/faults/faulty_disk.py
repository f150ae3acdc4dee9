"""Commands on a disk that fails: at a chosen step, or with all that was not confirmed lost."""

import contextlib
import dataclasses
import functools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Literal

Kind = Literal["nothing", "kill", "interrupt", "broken", "full"]

HERE = Path(__file__).parent


def builds_faults() -> bool:
    """Whether faults can be made here: they replace functions of the C library of Linux."""
    return sys.platform == "linux" and shutil.which("gcc") is not None


@functools.cache
def library(folder: Path) -> Path:
    """Build what stands between a program and the C library."""
    target = folder / "disk.so"
    subprocess.run(
        ["gcc", "-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", "-o", target,
         HERE / "disk.c", "-ldl"],
        check=True,
    )  # fmt: skip
    return target


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Parameters
    ----------
    code : int
        Exit code; the negative of the signal that killed it.
    trace : str
        A letter for each step: C new file, M new folder, W write, S fsync, R rename, L link, U
        removal, T truncation. Empty if it was killed.
    printed, told : str
        Standard output and error.
    """

    code: int
    trace: str
    printed: str
    told: str


class Commands:
    """Runs commands of the package with faults below a folder."""

    def __init__(self, process: subprocess.Popen[str], folder: Path) -> None:
        self._process, self._said = process, folder / "said"

    def warm(self, *argv: object) -> None:
        """Run a command where everything is forked from, so that all is loaded."""
        assert self._ask({"warm": [*map(str, argv)]})["code"] in (0, 1)

    def __call__(
        self,
        *argv: object,
        under: Path,
        kind: Kind = "nothing",
        at: int = 0,
        log: Path | None = None,
    ) -> Outcome:
        answer = self._ask(
            {
                "argv": [*map(str, argv)],
                "under": str(under),
                "kind": kind,
                "at": at,
                "log": None if log is None else str(log),
                "said": str(self._said),
            }
        )
        printed, told = (
            Path(f"{self._said}.{n}").read_text(encoding="utf-8") for n in ("out", "err")
        )
        return Outcome(answer["code"], answer["trace"], printed, told)

    def _ask(self, order: dict) -> dict:
        pipe: IO[str] | None = self._process.stdin
        assert pipe is not None
        assert self._process.stdout is not None
        pipe.write(json.dumps(order) + "\n")
        pipe.flush()
        return json.loads(self._process.stdout.readline())


@contextlib.contextmanager
def commands(folder: Path) -> Iterator[Commands]:
    """Start the process that forks for every command."""
    own = os.environ | {"LD_PRELOAD": str(library(folder)), "OPENBLAS_NUM_THREADS": "1"}
    own["PYTHONPATH"] = f"{folder}:{own.get('PYTHONPATH', '')}"  # for extensions that are there
    with subprocess.Popen(
        [sys.executable, HERE / "zygote.py"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=own,
        cwd=folder,
    ) as process:
        yield Commands(process, folder)
        assert process.stdin is not None
        process.stdin.close()


def files(folder: Path) -> dict[str, bytes]:
    """Path in a folder to content, all that is there."""
    if not folder.exists():
        return {}
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and not p.is_symlink()
    }


@dataclasses.dataclass(frozen=True)
class Cut:
    """A power cut after some entries of the log; names are those of the first `named` of them."""

    after: int
    named: int


class Disk:
    """What a disk would hold after a power cut: files as of their fsync, names in order.

    Names reach the disk in the order in which they change, as those of a file system with a
    journal; all that changed before a folder was told to be on the disk is there.

    Parameters
    ----------
    before : Path
        The folder as it was at first.
    folder : Path
        The folder that was written to, as the log names it.
    log : Path
        Folder of the log.
    """

    def __init__(self, before: Path, folder: Path, log: Path) -> None:
        self.folder, self.log = str(folder), log
        at_first = sorted(before.rglob("*"))
        self._names = {self._path(before, p): str(p) for p in at_first if not p.is_dir()}
        self._folders = {self._path(before, p) for p in at_first if p.is_dir()} | {self.folder}
        self._contents = {str(p): p.read_bytes() for p in at_first if p.is_file()}
        lines = (log / "log").read_text(encoding="utf-8").splitlines()
        self.entries = self._numbered([line.split("\t") for line in lines])

    def _path(self, root: Path, path: Path) -> str:
        return f"{self.folder}/{path.relative_to(root)}"

    def _numbered(self, entries: list[list[str]]) -> list[list[str]]:
        """Entries with files by when they were made: numbers of inodes are given again."""
        made: dict[str, str] = {}
        found = []
        for k, (what, *about) in enumerate(entries):
            if what == "C":
                made[about[0]] = f"{about[0]}@{k}"
            if what in "CS":
                about[0] = made.get(about[0], about[0])
            found.append([what, *about])
        return found

    def cuts(self, every: int = 1) -> Iterator[Cut]:
        """Cuts with all names there, with only those that must be, and half way between."""
        sure = 0
        for after in range(0, len(self.entries) + 1, every):
            told = [k for k in range(sure, after) if self.entries[k][0] == "N"]
            sure = told[-1] + 1 if told else sure
            for named in sorted({sure, (sure + after) // 2, after}):
                yield Cut(after, named)

    def build(self, cut: Cut, target: Path) -> None:
        """Make the folder that is found after a cut."""
        names, folders, contents = dict(self._names), set(self._folders), dict(self._contents)
        for entry in self.entries[: cut.named]:
            self._renamed(entry, names, folders)
        for what, *about in self.entries[: cut.after]:
            if what == "S":
                contents[about[0]] = (self.log / about[1]).read_bytes()
        shutil.rmtree(target, ignore_errors=True)
        for path in sorted(folders):
            Path(target, path[len(self.folder) + 1 :]).mkdir(exist_ok=True)
        for path, number in names.items():
            Path(target, path[len(self.folder) + 1 :]).write_bytes(contents.get(number, b""))

    @staticmethod
    def _renamed(entry: Sequence[str], names: dict[str, str], folders: set[str]) -> None:
        match entry:
            case ["C", number, path]:
                names[path] = number
            case ["M", path]:
                folders.add(path)
            case ["L", one, two]:
                names[two] = names[one]
            case ["U", path]:
                names.pop(path, None)
                folders.discard(path)
            case ["R", one, two] if one in folders:
                folders.remove(one)
                folders.add(two)
                for path in [p for p in names if p.startswith(f"{one}/")]:
                    names[two + path[len(one) :]] = names.pop(path)
                for path in [p for p in folders if p.startswith(f"{one}/")]:
                    folders.remove(path)
                    folders.add(two + path[len(one) :])
            case ["R", one, two]:
                names[two] = names.pop(one)
