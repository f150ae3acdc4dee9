"""Rows of an even grid of which the oldest are dropped and newer ones are added all the time."""

from collections.abc import Sequence

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

    def put(
        self, columns: Sequence[int], slots: np.ndarray, values: Array
    ) -> tuple[int, np.ndarray]:
        """Put values (n, m) into columns of the rows at slots (n,); the first one counts.

        Returns
        -------
        duplicates : int
            Values of which there was one already.
        changed : (n,) array of bool
            Samples of which a value was put.
        """
        self.extend(int(slots.max()) + 1)
        rows = self.view(self.base, self.stop)
        duplicates, changed = 0, np.zeros(len(slots), bool)
        rest = np.arange(len(slots))
        while len(rest):  # once, unless a slot comes several times
            _, first = np.unique(slots[rest], return_index=True)
            chosen = rest[first]
            where = np.ix_(slots[chosen] - self.base, np.array(columns, int))
            there, given = rows[where], values[chosen]
            free = np.isnan(there) & np.isfinite(given)
            rows[where] = np.where(free, given, there)
            duplicates += int((np.isfinite(given) & ~free).sum())
            changed[chosen] = free.any(axis=1)
            rest = np.delete(rest, first)
        return duplicates, changed

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
