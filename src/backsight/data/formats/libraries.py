"""Libraries that only some formats need: imported when a file of theirs is read."""

import importlib
from typing import Any

from backsight.errors import DataError


def library(name: str) -> Any:
    """Import a library, or say how to install it (`DataError`)."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        raise DataError(
            f"files of this kind need the library {package} ({error}); pip install "
            "'backsight[formats]'"
        ) from None
