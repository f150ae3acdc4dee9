"""The sources of the kernels; needs nothing, since the build uses it, too."""

import hashlib
import itertools
from pathlib import Path

FOLDER = Path(__file__).parent
"""Where the sources are, and the library that is made of them."""

BRIDGE = "bridge"
"""The one source that is no kernel."""


def names() -> list[str]:
    """Names of the kernels."""
    return sorted(file.stem for file in FOLDER.glob("*.c") if file.stem != BRIDGE)


def files(kernels: list[str] | tuple[str, ...]) -> list[Path]:
    """Everything that is needed to compile these kernels."""
    own = ([*sorted(FOLDER.glob(f"{name}_*.h")), FOLDER / f"{name}.c"] for name in kernels)
    return [FOLDER / "kernels.h", *itertools.chain.from_iterable(own)]


def fingerprint() -> str:
    """Return a word that changes with every change of the sources."""
    everything = [*files(names()), FOLDER / f"{BRIDGE}.c"]
    texts = (file.name.encode() + file.read_bytes() for file in everything)
    return "s" + hashlib.sha256(b"".join(texts)).hexdigest()[:32]
