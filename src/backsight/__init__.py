"""Estimate states, parameters and unknown forces of machines from a model and measurements.

The public names are imported when they are used first, so that the command line and programs that
need a few of them start at once. The table of them is ``__init__.pyi``, which editors and type
checkers read as well.
"""

from backsight.doors import found as _found
from backsight.doors import homes as _homes

# The function must hide the folder of the same name, which it does if it is bound after it.
from backsight.report import report as report

_HOMES = _homes(__path__[0])


def __getattr__(name: str) -> object:
    if name == "__version__":
        import importlib.metadata

        version: object = importlib.metadata.version(__name__)
        globals()[name] = version
        return version
    return _found(__name__, name, _HOMES)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "__version__"})
