"""Tries everything that an installation must do, with the Python that runs this file.

    python tests/wheels/installed.py [--without-kernels]

It works in a temporary folder on a copy of the examples, and the programs that it starts find
nothing but the scripts of this environment on their PATH: no compiler, and no source of the
package. With `--without-kernels` it tries an installation that was made without a compiler.
"""

import argparse
import dataclasses
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

from backsight.estimators.parts.covariance import Covariance
from backsight.problem import load

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = Path(sysconfig.get_path("scripts"))
COMPILERS = ("cc", "gcc", "clang", "c99", "cl", "tcc")

PLACE = """
import pathlib, sys, backsight
assert pathlib.Path(backsight.__file__).is_relative_to(sys.prefix), backsight.__file__
"""

KERNELS = """
from backsight.kernels import library
library.handle()
"""

REMEDY = "the C kernels of Backsight are not compiled: install a C compiler"
"""Part of what an installation without kernels says."""


SAID = {"examples/frame/run.py": "4 hits found"}
"""What a program ends in, if not in a verdict of consistency."""


@dataclasses.dataclass(frozen=True)
class Try:
    """A program to run, and what it must do.

    Parameters
    ----------
    name : str
        For the summary.
    command : sequence of str
    code : int
        Its exit code.
    says : str
        What must be in its output.
    writes : tuple of str
        Files that it must write.
    """

    name: str
    command: Sequence[str]
    code: int = 0
    says: str = ""
    writes: tuple[str, ...] = ()

    def failure(self, folder: Path, environment: dict[str, str]) -> str:
        """Run it; what went wrong, or nothing."""
        done = subprocess.run(
            self.command,
            cwd=folder,
            env=environment,
            capture_output=True,
            encoding="utf-8",
            timeout=600,
        )
        told = done.stdout + done.stderr
        if done.returncode != self.code:
            return f"exit code {done.returncode} instead of {self.code}:\n{told}"
        if "Traceback" in told:
            return f"a traceback:\n{told}"
        if self.says not in " ".join(told.split()):
            return f"says nothing of '{self.says}':\n{told}"
        absent = [name for name in self.writes if not (folder / name).is_file()]
        return f"does not write {', '.join(absent)}" if absent else ""


def backsight(*arguments: str) -> list[str]:
    """The command that was installed."""
    return [str(SCRIPTS / "backsight"), *arguments]


def problems(folder: Path) -> Iterator[tuple[str, bool]]:
    """Every problem file whose recording ships, and whether it needs a kernel.

    Those of an extension, which is a distribution of its own, need that one installed; what runs
    live has no recording.
    """
    for file in sorted(folder.glob("examples/*/*.toml")):
        if (file.parent / "pyproject.toml").is_file():
            continue
        given = tomllib.loads(file.read_text(encoding="utf-8"))
        if "recording" in given and "${" not in given["recording"]["path"]:
            kinds = {entry["kind"] for entry in given["estimators"].values()}
            needs_kernel = "csmhe" in kinds or Covariance(load(file).model.nx).whole
            yield file.relative_to(folder).as_posix(), needs_kernel


def basic() -> Iterator[Try]:
    """What needs no recording."""
    yield Try("it is the one that was installed", [sys.executable, "-c", PLACE])
    for word, says in (("--version", "."), ("--help", "Usage"), ("methods", 'kind = "csmhe"')):
        yield Try(f"backsight {word}", backsight(word), says=says)


def runs(folder: Path) -> Iterator[Try]:
    """Everything that the examples and the README show."""
    yield Try("the kernels are of these sources", [sys.executable, "-c", KERNELS])
    for number, (file, _) in enumerate(problems(folder)):
        out = f"out/{number}"
        written = tuple(f"{out}/{name}" for name in ("estimates.nc", "summary.json", "report.html"))
        yield Try(f"backsight check {file}", backsight("check", file))
        yield Try(f"backsight run {file}", backsight("run", file, "-o", out), writes=written)
    for file, estimator in (("stage/problem.toml", "MHO"), ("beam/problem.toml", "CS-MHE")):
        prefix = estimator.lower().replace("-", "_")
        written = tuple(f"c/{prefix}/{prefix}{ending}" for ending in (".c", ".h", "_selftest.c"))
        command = backsight("export", f"examples/{file}", "-e", estimator, "-o", f"c/{prefix}")
        yield Try(f"backsight export {file} {estimator}", command, writes=written)
    programs = {p for file, _ in problems(folder) for p in (folder / file).parent.glob("*.py")}
    for program in sorted(programs):
        name = program.relative_to(folder).as_posix()
        says = "wrote" if program.name.startswith("make_") else SAID.get(name, "consistent")
        yield Try(f"python {name}", [sys.executable, "-W", "error", name], says=says)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    assert blocks, "README.md has no program"
    for number, block in enumerate(blocks):
        (folder / f"readme_{number}.py").write_text(block, encoding="utf-8")
        command = [sys.executable, "-W", "error", f"readme_{number}.py"]
        yield Try(f"program {number + 1} of README.md", command, writes=("out/report.html",))


def without_kernels(folder: Path) -> Iterator[Try]:
    """What an installation that was made without a compiler still does, and what it says."""
    yield Try("methods say what is missing", backsight("methods"), says=REMEDY)
    for number, (file, needs_kernel) in enumerate(problems(folder)):
        code, says = (2, REMEDY) if needs_kernel else (0, "")
        yield Try(f"backsight check {file}", backsight("check", file), code=code, says=says)
        command = backsight("run", file, "-o", f"out/{number}")
        yield Try(f"backsight run {file}", command, code=code, says=says)


def environment(folder: Path) -> dict[str, str]:
    """Variables of the programs: no compiler, no other packages, nothing compiled before."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return kept | {
        "PATH": str(SCRIPTS),
        "CC": "/bin/false",
        "BACKSIGHT_CACHE": str(folder / "cache"),
        "PYTHONUTF8": "1",
        "MPLBACKEND": "agg",
    }


def main() -> int:
    """Run all and print a line for each; 1 if one of them failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--without-kernels", action="store_true")
    chosen = parser.parse_args()
    found = [name for name in COMPILERS if shutil.which(name, path=str(SCRIPTS))]
    assert not found, f"there are compilers in {SCRIPTS}: {found}"
    failed = 0
    with tempfile.TemporaryDirectory(prefix="backsight-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        shutil.copytree(ROOT / "examples", folder / "examples")
        tries = [*basic(), *(without_kernels if chosen.without_kernels else runs)(folder)]
        for entry in tries:
            began = time.perf_counter()
            failure = entry.failure(folder, environment(folder))
            failed += bool(failure)
            word = "FAILED" if failure else "ok"
            print(f"{word:>6}  {time.perf_counter() - began:5.1f} s  {entry.name}", flush=True)
            if failure:
                print(failure, flush=True)
    print(f"{len(tries) - failed} of {len(tries)} as expected")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
