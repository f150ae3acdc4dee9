"""Clocks by their names: which column is one, and in what its numbers count."""

import re

_NAME = re.compile(
    r"(?:\w+[/ _.-])?(?:rel|abs|elapsed|sample|daq)?[ _.-]?"
    r"(?:t|time|times|zeit|temps|tempo|tiempo|tid|timestamps?|stamps?|seconds?|sec|clock|uhrzeit|"
    r"datetime|date|x_value)(?:(?: in |[ _.-]| ?/ ?)(?P<unit>[a-zµμ]+))?(?:\s*[(\[].*)?",
    re.IGNORECASE,
)

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek"), 1.0),
    **dict.fromkeys(("ms", "msec", "milliseconds", "millis"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microseconds", "micros"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanoseconds", "nanos"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
}
"""Units of clocks [s]."""


def is_clock(name: str) -> bool:
    """Whether a column is time by its name, of its group or not: ``imu/t_ms``."""
    return _NAME.fullmatch(name.rpartition("/")[2]) is not None or _NAME.fullmatch(name) is not None


def unit_of_clock(name: str) -> str:
    """Unit that the name of a clock says, ``t_ms``, ``Time / us``; "" if it says none."""
    match = _NAME.fullmatch(name) or _NAME.fullmatch(name.rpartition("/")[2])
    word = (match["unit"] or "") if match else ""
    return word if word in SECONDS else word.lower() if word.lower() in SECONDS else ""
