"""A sampling period that a file tells as a number of its own, beside the signals."""

import dataclasses
import math
import re
from collections.abc import Callable, Sequence

from backsight.data._request import Listed

_RATE = re.compile(r"f_?s(?:amp\w*)?|s(?:ample)?_?rate|sampl\w*_?(?:rate|freq\w*|hz)|rate", re.I)
_PERIOD = re.compile(r"dt|t_?s|delta_?t|sampl\w*_?(?:time|period|interval)|period|interval", re.I)

SAME = 1e-6
"""Relative difference of periods that say the same."""


@dataclasses.dataclass(frozen=True)
class ToldPeriod:
    """A number that seems to be a rate or a period.

    Parameters
    ----------
    name : str
        In the file.
    value : float
        What the file says.
    dt : float
        Sampling period that follows [s].
    """

    name: str
    value: float
    dt: float

    def __str__(self) -> str:
        return f"'{self.name}' is {self.value:g}"


def told_period(
    listed: Sequence[Listed], number: Callable[[str], float | None]
) -> ToldPeriod | None:
    """The period that numbers of a file tell by their names; None if none does, or they disagree.

    Parameters
    ----------
    listed : sequence of Listed
    number : callable
        Value of what is listed as no signal, None if it is not one number.
    """
    found = []
    for entry in listed:
        own = re.split(r"[/.]", entry.name)[-1]
        rate, period = _RATE.fullmatch(own), _PERIOD.fullmatch(own)
        if entry.kind != "other" or not (rate or period):
            continue
        value = number(entry.name)
        if value is not None and math.isfinite(value) and value > 0:
            found.append(ToldPeriod(entry.name, value, 1 / value if rate else value))
    if not found or max(f.dt for f in found) > (1 + SAME) * min(f.dt for f in found):
        return None
    return found[0]
