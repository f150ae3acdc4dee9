"""Excitation signals, motion profiles and filters, in NumPy."""

from backsight.signals.binary import prbs
from backsight.signals.difference import central_difference
from backsight.signals.filters import bandpass, filtered, high_pass
from backsight.signals.profiles import (
    Motion,
    Profile,
    jerk_limited,
    punch_strokes,
    quintic,
    rest,
    sequence,
)

__all__ = [
    "Motion",
    "Profile",
    "bandpass",
    "central_difference",
    "filtered",
    "high_pass",
    "jerk_limited",
    "prbs",
    "punch_strokes",
    "quintic",
    "rest",
    "sequence",
]
