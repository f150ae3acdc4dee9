"""Libraries that only some formats need: imported when a file of theirs is read."""

import importlib
import logging
from typing import Any

from backsight.errors import DataError


def library(name: str) -> Any:
    """Import a library, or say how to install it (`DataError`)."""
    package = name.partition(".")[0]
    try:
        found = importlib.import_module(name)
    except ImportError as error:
        raise DataError(
            f"files of this kind need the library {package} ({error}); pip install "
            "'backsight[formats]'"
        ) from None
    # What is wrong with a file is told by us, in one line.
    for logger in [n for n in logging.root.manager.loggerDict if n.startswith(package)]:
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    return found
