"""Exceptions of the package: one family for everything a user can mend."""

import difflib
from collections.abc import Iterable


class BacksightError(Exception):
    """Base of all errors that a user can mend; the command line shows them in one line."""


class ModelError(BacksightError):
    """A model is described wrongly: names, sizes, equations."""


class TuningError(BacksightError):
    """An estimator, its noise or its prior is described wrongly."""


class DataError(BacksightError):
    """A recording cannot be read or does not fit the model."""


class ProblemError(BacksightError):
    """A problem file has an entry that is missing, unknown or of the wrong kind."""


class OutputError(BacksightError):
    """Results cannot be written where they should go."""


class EngineError(BacksightError):
    """A recursion cannot be turned into machine code or C."""


class PluginError(BacksightError):
    """An installed extension is broken, or brings something under a name that is taken."""


class EstimationError(BacksightError):
    """An estimator failed on a recording; ``results`` holds everything up to there.

    Parameters
    ----------
    message : str
        What happened, at which sample, and what to do.
    results : xarray.Dataset
        The result as far as it is valid, with the status of every sample.
    """

    def __init__(self, message: str, results: object) -> None:
        super().__init__(message)
        self.results = results


MOST_NAMES = 12


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint that names the known name closest to a misspelled one, or lists all."""
    names = sorted(str(k) for k in known)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"known: {', '.join(names[:MOST_NAMES])}{more}" if names else "there are none"
