"""MISRA C:2012 by cppcheck, and the warnings of another compiler."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.export import export_c
from backsight.kernels import sources
from backsight.testing import CASES

ROOT = Path(__file__).parents[2]
needs_cppcheck = pytest.mark.skipif(shutil.which("cppcheck") is None, reason="needs cppcheck")
needs_clang = pytest.mark.skipif(
    importlib.util.find_spec("ziglang") is None, reason="needs ziglang, which brings clang"
)
NEVER = {"2.5"}
"""Advisory: a macro that is not used; sizes are for whom they may concern."""

STRICT = [
    "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion",
    "-Wvla", "-Werror", "-O1",
]  # fmt: skip


def exported(key, folder, **given):
    """Export an estimator of the contract with all that can be tuned simply."""
    problem = CASES[key].problem
    estimator = CASES[key].build(problem, Integrator("rk4", 1))
    recording = problem.simulate(30, seed=5, hold="zoh", noisy=True).recording(problem.model)
    export_c(
        estimator, problem.model, recording, folder, name="it", tunable=["x0", "sigma_x0"], **given
    )


def broken(file):
    """Rules that a file and what it includes break: (file, rule) pairs."""
    said = subprocess.run(
        [
            "cppcheck", "--std=c99", "--addon=misra", "--quiet",
            "--suppress=missingIncludeSystem", "--template={file} {id}", str(file),
        ],
        capture_output=True,
        text=True,
    )  # fmt: skip
    found = re.findall(r"(\S+) misra-c2012-(\d+\.\d+)", said.stdout + said.stderr)
    return {(Path(where).name, rule) for where, rule in found}


@needs_cppcheck
@pytest.mark.slow
@pytest.mark.parametrize("key", list(CASES))
def test_what_is_written_breaks_no_required_rule(key, tmp_path):
    exported(key, tmp_path)
    own = {rule for where, rule in broken(tmp_path / "it.c") if where in ("it.c", "it.h")}
    assert own <= NEVER


@needs_cppcheck
@pytest.mark.slow
def test_what_kernels_break_is_written_down(tmp_path):
    page = (ROOT / "docs" / "misra.md").read_text()
    known = set(re.findall(r"^\| (\d+\.\d+) \| required", page, re.M))
    (advisory,) = re.findall(r"kernels break ([\d., and]+)", page)
    known |= set(re.findall(r"\d+\.\d+", advisory))
    for file in sources.files(sources.names()):
        (tmp_path / file.name).write_text(file.read_text("utf-8"))
    included = ["kernels.h", *(f"{name}.c" for name in sources.names())]
    lines = ["#define KERNEL static inline", *(f'#include "{name}"' for name in included)]
    (tmp_path / "all.c").write_text("\n".join(lines) + "\n")
    found = {rule for _, rule in broken(tmp_path / "all.c")}
    assert found
    assert found <= known, found - known


@needs_clang
@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("key", list(CASES))
def test_clang_warns_of_nothing(key, precision, tmp_path):
    exported(key, tmp_path, precision=precision, accuracy=float("inf"))
    command = [sys.executable, "-m", "ziglang", "cc", *STRICT, "-c", "it.c", "-o", "it.o"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
