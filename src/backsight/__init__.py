"""Estimate states, parameters and unknown forces of machines from a model and measurements.

The public names are imported when they are used first, so that the command line and programs that
need a few of them start at once. The table of them is ``__init__.pyi``, which editors and type
checkers read as well.
"""

import importlib

# The function must hide the folder of the same name, which it does if it is bound after it.
from backsight.report import report as report


def _read() -> dict[str, str]:
    """Name to module, from lines ``from MODULE import NAME as NAME``."""
    with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as table:
        lines = [line.split() for line in table if line.startswith("from ")]
    return {name: module for _, module, _, name, *_ in lines}


_HOMES = _read()


def __getattr__(name: str) -> object:
    if name == "__version__":
        found: object = importlib.import_module("importlib.metadata").version(__name__)
    elif _HOMES.get(name) == __name__:
        found = importlib.import_module(f"{__name__}.{name}")
    elif name in _HOMES:
        found = getattr(importlib.import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'", name=name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "__version__"})
