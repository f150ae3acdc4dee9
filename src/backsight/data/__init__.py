"""Read, check, align and merge recordings."""

from backsight.data.columns import Column
from backsight.data.rates import merge, resample
from backsight.data.reader import read
from backsight.data.recording import from_arrays

__all__ = ["Column", "from_arrays", "merge", "read", "resample"]
