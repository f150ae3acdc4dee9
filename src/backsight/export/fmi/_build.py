"""Compile the sources of an FMU, for this machine or for others."""

import importlib.util
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Literal, TypeAlias

from backsight.errors import EngineError

Platform: TypeAlias = Literal[
    "x86_64-linux", "aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"
]
"""Platforms by their names in FMI 3.0, 2.5.1.4."""

TARGETS: dict[str, tuple[str, str]] = {
    "x86_64-linux": ("x86_64-linux-gnu.2.17", "so"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", "so"),
    "x86_64-windows": ("x86_64-windows-gnu", "dll"),
    "x86_64-darwin": ("x86_64-macos", "dylib"),
    "aarch64-darwin": ("aarch64-macos", "dylib"),
}
"""Names for zig, and the end of a library's name."""

# Contracted products would round otherwise than Python does.
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"]
WARNINGS = ["-Wall", "-Wextra", "-Wno-unused-parameter"]

PATIENCE = 600
"""Seconds after which a compiler is given up."""


def this_machine() -> str:
    """The platform that this program runs on."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    return f"{machine}-{system}"


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
    options = [*FLAGS, *position, *WARNINGS]
    command = [*_compiler(target), *options, "-o", library.name, *sources, *mathematics]
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


def _compiler(target: str) -> list[str]:
    own = shutil.which("cc") or shutil.which("gcc")
    if target == this_machine() and own is not None:
        return [own]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target][0]]
    raise EngineError(
        f"there is no C compiler for {target}: install one for all platforms by "
        "'pip install backsight[fmi]', or leave the platform out"
    )
