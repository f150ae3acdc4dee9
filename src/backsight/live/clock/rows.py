"""Rows of an even grid of which the oldest are dropped and newer ones are added all the time."""

import numpy as np

from backsight.types import Array

_LEAST = 1024


class RowBuffer:
    """Rows (width,) by their slots on the grid, from `base` up to `stop`; NaN until they are set.

    Memory grows with the largest number of rows that were ever held at once, not with time.

    Parameters
    ----------
    width : int
        Numbers in a row.
    base : int
        Slot of the first row.
    """

    def __init__(self, width: int, base: int = 0) -> None:
        self._rows = np.full((_LEAST, width), np.nan)
        self._first = 0
        self.base = self.stop = base

    def extend(self, stop: int) -> None:
        """Add rows up to a slot."""
        if stop <= self.stop:
            return
        last, held = self._first + stop - self.base, self.stop - self.base
        if last > len(self._rows):
            room = max(_LEAST, 2 * (stop - self.base))
            rows = np.full((room, self._rows.shape[1]), np.nan)
            rows[:held] = self._rows[self._first : self._first + held]
            self._rows, self._first = rows, 0
        else:
            self._rows[self._first + held : last] = np.nan
        self.stop = stop

    def view(self, start: int, stop: int) -> Array:
        """Rows of the slots from `start` up to `stop`; what is written to them is kept."""
        shift = self._first - self.base
        return self._rows[start + shift : stop + shift]

    def drop(self, base: int) -> None:
        """Forget the rows before a slot."""
        self._first += base - self.base
        self.base, self.stop = base, max(self.stop, base)
        if self.base == self.stop:
            self._first = 0

    def begin(self, base: int) -> None:
        """Forget all rows; the next one is that of another slot."""
        self.base = self.stop = base
        self._first = 0
