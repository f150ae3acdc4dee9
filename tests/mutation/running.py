"""Run the tests that can notice a change, each time in a new process on a copy of the package.

The copy is what is changed, so that processes that a test starts see the change as well. Its
bytecode is checked by the content of the sources: by size and time, a change of one letter within a
second would go unnoticed. What is compiled to machine code is kept in a folder of its own.
"""

import compileall
import contextlib
import dataclasses
import json
import os
import py_compile
import select
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tests.mutation.mutants import Mutant, changed_text

ROOT = Path(__file__).parents[2]

BROKEN = 44
"""Exit code if it is not the change that has failed."""

PATIENCE, CPU = 1200.0, 60
"""Seconds that pass, and of the processor, until a mutant has no end. The first is for a machine
that others use, too: what is slow there is not wrong."""

MEMORY = 8 << 30
"""Bytes of address space."""


@dataclasses.dataclass(frozen=True)
class Ran:
    """What came of some tests.

    Parameters
    ----------
    code : int
        Exit code; the negative of a signal.
    seconds : dict of str to float
        Tests that passed, and how long they took.
    failed : tuple of str
    """

    code: int
    seconds: dict[str, float]
    failed: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """ "survived", "failed", "no end", "died", "not run"."""
        if self.code == BROKEN:
            raise RuntimeError(f"the tests did not run on the copy: {self.failed}")
        if self.code in (4, 5):
            return "not run"
        if self.code == -signal.SIGXCPU or self.code == -signal.SIGKILL:
            return "no end"
        return {0: "survived", 1: "failed", 2: "failed"}.get(self.code, "died")


class Chosen:
    """For pytest: runs these tests in this order and notes what came of them.

    Parameters
    ----------
    tests : sequence of str
    known : set of str
        Tests that are left out if they are not among these; a newer one runs at the end.
    """

    def __init__(self, tests: Sequence[str], known: Iterable[str]) -> None:
        self._place = {name: k for k, name in enumerate(tests)}
        self._known = set(known)
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []

    def pytest_collection_modifyitems(self, items: list) -> None:
        last = len(self._place)
        kept = [i for i in items if i.nodeid in self._place or i.nodeid not in self._known]
        items[:] = sorted(kept, key=lambda i: self._place.get(i.nodeid, last))

    def pytest_runtest_logreport(self, report) -> None:
        if report.failed:
            self.failed.append(report.nodeid)
        else:
            before = self.seconds.get(report.nodeid, 0.0)
            self.seconds[report.nodeid] = before + report.duration


class Copy:
    """A copy of the package in which one file at a time is changed.

    Parameters
    ----------
    folder : Path
        Empty.
    package : Path
        What is copied.
    """

    def __init__(self, folder: Path, package: Path) -> None:
        self.folder, self._original = folder, package
        self.source = folder / "src"
        self.package = self.source / package.name
        shutil.copytree(package, self.package, ignore=shutil.ignore_patterns("__pycache__"))
        checked = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(self.package, quiet=2, invalidation_mode=checked)

    @contextlib.contextmanager
    def changed(self, mutant: Mutant) -> Iterator[bool]:
        """Change a file, and build kernels anew if it is one of theirs; whether it is a program."""
        target = self.package / mutant.file.relative_to(self._original)
        target.write_text(changed_text(mutant), encoding="utf-8")
        kernels = mutant.file.suffix != ".py"
        try:
            yield not kernels or self.build()
        finally:
            shutil.copyfile(mutant.file, target)
            if kernels:
                for library in (self._original / "kernels").glob("_backsight*.so"):
                    shutil.copyfile(library, self.package / "kernels" / library.name)

    def build(self) -> bool:
        """Compile the kernels of the copy; whether that went well."""
        import runpy

        home = self.package / "kernels"
        found = runpy.run_path(str(home / "sources.py"))
        names = " ".join(f"X({name})" for name in found["names"]())
        (library,) = home.glob("_backsight*.so")
        library.unlink()  # another process may still have the old one in its memory
        done = subprocess.run(
            ["gcc", "-shared", "-fPIC", "-w", "-std=c99", "-O1", f"-I{home}", f"-DKERNELS={names}",
             f"-DSOURCES={found['fingerprint']()}", "-DBACKSIGHT_BLAS", "-o", library,
             home / "bridge.c", *found["kernel_files"](), "-lm"],
            capture_output=True,
            check=False,
        )  # fmt: skip
        return done.returncode == 0

    def run(self, tests: Sequence[str], known: Iterable[str], *, all_of_them: bool = False) -> Ran:
        """Run tests until one fails."""
        told = self.folder / "told.json"
        told.unlink(missing_ok=True)
        child = os.fork()
        if not child:
            os.setpgid(0, 0)
            self._child(tests, known, told, all_of_them=all_of_them)
        with contextlib.suppress(OSError):  # it may have done so itself
            os.setpgid(child, child)
        code = _waited(child)
        if code == BROKEN:
            return Ran(code, {}, ((self.folder / "error.txt").read_text(encoding="utf-8"),))
        if not told.exists():
            return Ran(code, {}, ())
        about = json.loads(told.read_text(encoding="utf-8"))
        return Ran(code, about["seconds"], tuple(about["failed"]))

    def _child(
        self, tests: Sequence[str], known: Iterable[str], told: Path, *, all_of_them: bool
    ) -> None:
        import resource

        code = BROKEN
        try:
            seconds = 3600 if all_of_them else CPU
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            sys.dont_write_bytecode = True
            sys.path.insert(0, str(self.source))
            os.environ |= {
                "PYTHONDONTWRITEBYTECODE": "1",
                "PYTHONPATH": f"{self.source}:{ROOT}",
                "BACKSIGHT_CACHE": str(self.folder / "cache"),
                "OPENBLAS_NUM_THREADS": "1",
            }
            log = os.open(self.folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1)
            os.dup2(log, 2)
            import pytest

            plugin = Chosen(tests, known)
            quiet = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow"]
            first = [] if all_of_them else ["-x"]
            place = ["--rootdir", str(ROOT), "--basetemp", str(self.folder / "tmp")]
            files = dict.fromkeys(name.partition("::")[0] for name in tests)
            code = int(pytest.main([*quiet, *first, *place, *files], plugins=[plugin]))
            if (used := sys.modules.get("backsight")) is not None:
                assert str(used.__file__).startswith(str(self.package)), used.__file__
            about = {"seconds": plugin.seconds, "failed": plugin.failed}
            told.write_text(json.dumps(about), encoding="utf-8")
        except BaseException:
            # Ours, not the change's: what that raises pytest has caught.
            (self.folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
            code = BROKEN
        finally:
            os._exit(code)


def load_all_but_the_package() -> None:
    """Import what the package and its tests import from elsewhere: a fork then has it.

    Not what are plugins of pytest: it wants to see those first.
    """
    import casadi  # noqa: F401
    import h5netcdf  # noqa: F401
    import llvmlite.binding  # noqa: F401
    import pandas  # noqa: F401
    import pint  # noqa: F401
    import pydantic  # noqa: F401
    import pytest  # noqa: F401
    import rich.console  # noqa: F401
    import scipy.linalg
    import scipy.optimize
    import scipy.signal
    import scipy.stats  # noqa: F401
    import typer.testing  # noqa: F401
    import xarray  # noqa: F401

    assert not any(n.partition(".")[0] == "backsight" for n in sys.modules)


def _waited(child: int) -> int:
    """Exit code; whatever the child has started is ended with it."""
    handle = os.pidfd_open(child)
    end = time.monotonic() + PATIENCE
    try:
        select.select([handle], [], [], max(end - time.monotonic(), 0.0))
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
    finally:
        os.close(handle)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
