"""Excitation signals and filters, in NumPy."""

from backsight.signals.binary import prbs
from backsight.signals.difference import central_difference
from backsight.signals.filters import bandpass, filtered

__all__ = ["bandpass", "central_difference", "filtered", "prbs"]
