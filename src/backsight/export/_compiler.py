"""C compilers of this machine, for it and for others."""

import importlib.util
import platform
import shutil
import sys
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


def this_machine() -> str:
    """The platform that this program runs on."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    return f"{machine}-{system}"


def compiler(target: str) -> list[str]:
    """Return the command of a compiler for a platform.

    Raises
    ------
    EngineError
        If there is none.
    """
    own = shutil.which("cc") or shutil.which("gcc")
    if target == this_machine() and own is not None:
        return [own]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target][0]]
    raise EngineError(
        f"there is no C compiler for {target}: install one for all platforms by "
        "'pip install backsight[fmi]', or leave the platform out"
    )
