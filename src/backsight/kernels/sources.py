"""The sources of the kernels; needs nothing, since the build uses it, too."""

import hashlib
import itertools
import os
from pathlib import Path
from typing import TypeAlias

FOLDER = Path(__file__).parent
"""Where the sources are, and the library that is made of them."""

BRIDGE = "bridge"
"""The one source that is no kernel."""


BLAS = "blas.h"
"""What the library of the package alone includes, beside the bridge."""


def kernel_files() -> list[Path]:
    """Return the source of every kernel, in the order of their names."""
    found = [file for file in FOLDER.rglob("*.c") if file.stem != BRIDGE]
    return sorted(found, key=lambda file: file.stem)


def names() -> list[str]:
    """Names of the kernels."""
    return [file.stem for file in kernel_files()]


def files(kernels: list[str] | tuple[str, ...]) -> list[Path]:
    """Everything that is needed to compile these kernels, each once."""
    own = (file for file in kernel_files() if file.stem in kernels)
    needed = itertools.chain([FOLDER / "kernels.h"], *(map(_with_headers, own)))
    return list(dict.fromkeys(needed))


def _with_headers(kernel: Path) -> list[Path]:
    """A kernel behind its parts; one in a folder behind all headers of the folder."""
    pattern = f"{kernel.stem}_*.h" if kernel.parent == FOLDER else "*.h"
    return [*sorted(kernel.parent.glob(pattern)), kernel]


State: TypeAlias = tuple[tuple[str, int, int], ...]
"""Path, size and time of the last change of every file."""


def state() -> State:
    """By what it is told, without reading them, whether the sources are still the same."""
    with os.scandir(FOLDER) as entries:
        found = list(entries)
    for folder in [e for e in found if e.is_dir()]:
        with os.scandir(folder) as entries:
            found += entries
    files_ = [e for e in found if e.name.endswith((".c", ".h"))]
    return tuple(sorted((e.path, e.stat().st_size, e.stat().st_mtime_ns) for e in files_))


def fingerprint() -> str:
    """Return a word that changes with every change of the sources."""
    bridge = [FOLDER / f"{BRIDGE}.c", *FOLDER.glob(BLAS)]
    texts = (file.name.encode() + file.read_bytes() for file in (*files(names()), *bridge))
    return "s" + hashlib.sha256(b"".join(texts)).hexdigest()[:32]
