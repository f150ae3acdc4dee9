"""Compile the sources of an FMU, for this machine or for others."""

import subprocess
from pathlib import Path

from backsight.errors import EngineError
from backsight.export._compiler import TARGETS, compiler

# Contracted products would round otherwise than Python does; straight-line code gains nothing by
# more of it, so that it is as small as can be.
FLAGS = ["-std=c99", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"]
SMALL = ["-Os", "-fno-tree-vectorize", "-fno-schedule-insns2", "-fno-asynchronous-unwind-tables"]
WARNINGS = ["-Wall", "-Wextra", "-Wno-unused-parameter"]

PATIENCE = 600
"""Seconds after which a compiler is given up."""


def library_name(name: str, target: str) -> str:
    """Where the library is in the FMU."""
    return f"binaries/{target}/{name}.{TARGETS[target][1]}"


def build(folder: Path, sources: list[str], target: str) -> bytes:
    """Compile sources in a folder to a library.

    Raises
    ------
    EngineError
        If there is no compiler for the platform, or it fails.
    """
    library = folder / f"built.{TARGETS[target][1]}"
    position = [] if target.endswith("windows") else ["-fPIC"]
    mathematics = [] if target.endswith("windows") else ["-lm"]
    options = [*FLAGS, *SMALL, *position, *WARNINGS]
    command = [*compiler(target), *options, "-o", library.name, *sources, *mathematics]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EngineError(f"the FMU could not be compiled for {target}: {error}") from error
    if done.returncode != 0 or not library.exists():
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise EngineError(f"the FMU could not be compiled for {target}: {last}")
    content = library.read_bytes()
    library.unlink()
    return content
