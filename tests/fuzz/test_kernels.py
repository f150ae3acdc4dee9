"""Kernels on sizes and numbers of any kind, with sanitizers."""

import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
KERNELS = HERE.parents[1] / "src" / "backsight" / "kernels"
CHECKS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
CALLS = 20_000


def build(folder: Path, *flags: str) -> Path:
    """Compile kernels and what calls them."""
    target = folder / "kernels"
    own = [KERNELS, KERNELS / "matrix"]
    subprocess.run(
        ["gcc", "-std=c99", "-O1", "-g", "-Wall", "-Werror", "-DMAIN", *CHECKS, *flags,
         *(f"-I{path}" for path in own), HERE / "kernels.c",
         *sorted((KERNELS / "matrix").glob("*.c")), "-o", target, "-lm"],
        check=True,
    )  # fmt: skip
    return target


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("precision", ["double", pytest.param("float", marks=pytest.mark.slow)])
def test_they_touch_only_what_is_theirs(tmp_path, precision):
    program = build(tmp_path, *(["-DBACKSIGHT_FLOAT"] if precision == "float" else []))
    done = subprocess.run([program, "1", str(CALLS)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{CALLS} calls\n"
