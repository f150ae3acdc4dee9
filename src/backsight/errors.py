"""Exceptions of the package: one family for everything a user can mend."""

import difflib
import unicodedata
from collections.abc import Iterable
from typing import Self


class BacksightError(Exception):
    """Base of all errors that a user can mend; the command line shows them in one line.

    Of a message that would fill pages, as when thousands of keys are wrong, the beginning and the
    end are kept.
    """

    bare: str | None = None
    """The message without what it is about, for those who name that themselves."""

    def __init__(self, message: str = "") -> None:
        super().__init__(shortened(message))

    @classmethod
    def about(cls, what: str, message: str) -> Self:
        """Make an error whose message begins with what it is about."""
        error = cls(f"{what}: {message}")
        error.bare = message
        return error


class BacksightWarning(UserWarning):
    """What a user should know and may want to mend; the command line shows it in one line."""


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


class WorkerError(BacksightError):
    """Workers that a fleet runs on cannot be reached, or do not fit."""


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


LONGEST = 1900
"""Characters of a message at most."""

_END = 300
"""Those of its end."""


def shortened(message: str) -> str:
    """Cut the middle of a message that nobody would read, and say so.

    The end stays: behind a path of thousands of characters stands what is wrong with it.
    """
    if len(message) <= LONGEST:
        return message
    return f"{message[: LONGEST - _END]}… (cut: {len(message)} characters) …{message[-_END:]}"


def printable(text: str) -> str:
    r"""Return a text in which every character is shown and none does anything.

    Control characters and those that turn the direction of writing, which would steer a terminal
    or show another text than is there, become their escapes (``\x1b``); line ends and tabs stay.
    """
    return "".join(c if c in "\n\t" or _is_shown(c) else ascii(c)[1:-1] for c in text)


def _is_shown(character: str) -> bool:
    return unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")


MOST_NAMES = 12


def nearest(name: str, known: Iterable[str]) -> str:
    """Return a hint that names the known name closest to a misspelled one, or lists all."""
    names = sorted(str(k) for k in known)
    close = difflib.get_close_matches(str(name), names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"known: {', '.join(names[:MOST_NAMES])}{more}" if names else "there are none"
