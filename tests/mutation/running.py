"""Run the tests that can notice a mutant, in a process that has loaded all but the package."""

import dataclasses
import importlib.abc
import importlib.machinery
import importlib.util
import os
import select
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType

from tests.mutation.mutants import Mutant, changed, changed_c

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"

NOT_RUN = 44
"""Exit code if pytest did not find the tests."""

SECONDS = 120.0
"""Of the tests of a mutant; one that never ends is noticed, too."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What came of a mutant.

    Parameters
    ----------
    mutant : Mutant
    killed : bool
        Whether a test failed.
    why : str
        "failed", "no end", "died", "is no program"; "survived", "no test gets there"; "not run".
    seconds : float
    """

    mutant: Mutant
    killed: bool
    why: str
    seconds: float


class _Changed(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Finds one module, as it is changed."""

    def __init__(self, name: str, file: Path, code: CodeType) -> None:
        self._name, self._file, self._code = name, file, code

    def find_spec(self, name, path=None, target=None):
        if name != self._name:
            return None
        inside = [str(self._file.parent)] if self._file.name == "__init__.py" else None
        return importlib.util.spec_from_file_location(
            name, self._file, loader=self, submodule_search_locations=inside
        )

    def get_source(self, fullname: str) -> str:
        return self._file.read_text(encoding="utf-8")

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, vars(module))


def module_of(file: Path) -> str:
    """Dotted name."""
    parts = file.relative_to(SOURCE).with_suffix("").parts
    return ".".join(p for p in parts if p != "__init__")


def load_all_but_the_package() -> None:
    """Import what the package and its tests import from elsewhere."""
    import casadi  # noqa: F401
    import h5netcdf  # noqa: F401
    import hypothesis  # noqa: F401
    import llvmlite.binding  # noqa: F401
    import pandas  # noqa: F401
    import pint  # noqa: F401
    import pydantic  # noqa: F401
    import pytest  # noqa: F401
    import scipy.linalg
    import scipy.optimize
    import scipy.signal  # noqa: F401
    import typer.testing  # noqa: F401
    import xarray  # noqa: F401


def judge(mutant: Mutant, tests: Sequence[str], folder: Path) -> Verdict:
    """Run tests on a mutant until one fails.

    Parameters
    ----------
    mutant : Mutant
    tests : sequence of str
        Of pytest, the quickest first.
    folder : Path
        For a library of kernels that are changed.
    """
    began = time.monotonic()
    if not tests:
        return Verdict(mutant, False, "no test gets there", 0.0)
    kernels = None
    if mutant.file.suffix != ".py":
        kernels = built(mutant, folder)
        if kernels is None:
            return Verdict(mutant, True, "is no program", time.monotonic() - began)
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        _child(mutant, tests, kernels, folder)
    code = _waited(child)
    known = {None: "no end", 0: "survived", 1: "failed", NOT_RUN: "not run"}
    killed = code not in (0, NOT_RUN)
    return Verdict(mutant, killed, known.get(code, "died"), time.monotonic() - began)


def _waited(child: int) -> int | None:
    handle = os.pidfd_open(child)
    try:
        if not select.select([handle], [], [], SECONDS)[0]:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
    finally:
        os.close(handle)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _child(mutant: Mutant, tests: Sequence[str], kernels: Path | None, folder: Path) -> None:
    code = NOT_RUN
    try:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        sys.dont_write_bytecode = True
        if kernels is not None:
            import backsight.kernels.sources as sources

            sources.FOLDER = kernels
        else:
            program = compile(changed(mutant), str(mutant.file), "exec")
            sys.meta_path.insert(0, _Changed(module_of(mutant.file), mutant.file, program))
        import pytest

        quiet = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--no-header"]
        found = pytest.main([*quiet, "-m", "not slow", *tests])
        # A file that cannot even be collected has noticed, too.
        code = NOT_RUN if found in (4, 5) else int(found != 0)
    except SystemExit:
        code = 1
    except BaseException:
        # Ours, not the mutant's: what a mutant raises pytest has caught.
        (folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
    finally:
        os._exit(code)


def built(mutant: Mutant, folder: Path) -> Path | None:
    """Compile kernels of which one is changed; None if that is no program."""
    import runpy

    home = SOURCE / "backsight" / "kernels"
    copy = folder / "kernels"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(home, copy, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    (copy / mutant.file.relative_to(home)).write_text(changed_c(mutant), encoding="utf-8")
    found = runpy.run_path(str(copy / "sources.py"))
    names = " ".join(f"X({name})" for name in found["names"]())
    done = subprocess.run(
        ["gcc", "-shared", "-fPIC", "-w", "-std=c99", "-O2", f"-I{copy}", f"-DKERNELS={names}",
         f"-DSOURCES={found['fingerprint']()}", "-DBACKSIGHT_BLAS", "-o",
         copy / "_backsight.abi3.so", copy / "bridge.c", *found["kernel_files"](), "-lm"],
        capture_output=True,
    )  # fmt: skip
    return copy if done.returncode == 0 else None
