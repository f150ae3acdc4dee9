"""Channels that are late by a fraction of a sample.

What was true at a slot lies on the line between two samples, as in `backsight.data.remove_delays`:
with a delay of ``whole + part`` periods it is ``(1 - part) y[k + whole] + part y[k + whole + 1]``.
"""

import numpy as np

from backsight.live.clock.rows import RowBuffer
from backsight.types import Array


class DelayLine:
    """Samples of which some wait for a neighbour.

    Parameters
    ----------
    whole : int
        Periods of the delay.
    part : float
        The rest of it, more than 0 and less than 1.
    width : int
        Channels with this delay.
    """

    def __init__(self, whole: int, part: float, width: int) -> None:
        self._whole, self._part, self._width = whole, part, width
        self._rows: RowBuffer | None = None

    @classmethod
    def of(cls, delay: float, width: int) -> "DelayLine":
        """The line of a delay in periods that is no whole number."""
        whole = int(np.floor(delay))
        return cls(whole, delay - whole, width)

    def through(
        self, slots: np.ndarray, values: Array, *, base: int
    ) -> tuple[np.ndarray, Array, int, np.ndarray]:
        """Take in samples (n, m) at slots (n,); what is known by them that was not known before.

        Parameters
        ----------
        slots, values
        base : int
            First slot that may still change.

        Returns
        -------
        places : (l,) array of int
            Slots at which something was true.
        moved : (l, m) array
            What was true, NaN where nothing became known.
        duplicates : int
            Values that were there already.
        changed : (n,) array of bool
            Samples that were new; too late ones are not.
        """
        first = base + self._whole
        if self._rows is None or self._rows.stop < first:
            self._rows = RowBuffer(self._width, first)
        self._rows.drop(max(first, self._rows.base))
        changed = slots >= self._rows.base
        if not changed.any():
            return np.empty(0, int), np.empty((0, self._width)), 0, changed
        held = slots[changed]
        low, high = max(int(held.min()) - 1, self._rows.base), int(held.max()) + 1
        self._rows.extend(high + 1)
        before = self._between(low, high)
        duplicates, put = self._rows.put(range(self._width), held, values[changed])
        changed[changed] = put
        after = self._between(low, high)
        moved = np.where(np.isnan(before), after, np.nan)
        return np.arange(low, high) - self._whole, moved, duplicates, changed

    def _between(self, start: int, stop: int) -> Array:
        """On the lines from the rows of slots to those after them."""
        assert self._rows is not None
        rows = self._rows.view(start, stop + 1)
        return (1 - self._part) * rows[:-1] + self._part * rows[1:]

    def kept(self) -> Array:
        """What must be kept to go on: samples with their slots in the first column, (n, 1 + m)."""
        if self._rows is None:
            return np.empty((0, 1 + self._width))
        base, stop = self._rows.base, self._rows.stop
        return np.column_stack([np.arange(base, stop, dtype=float), self._rows.view(base, stop)])

    def go_on(self, kept: Array) -> None:
        """Take over what was kept."""
        if len(kept):
            self._rows = RowBuffer(self._width, int(kept[0, 0]))
            self._rows.extend(int(kept[-1, 0]) + 1)
            self._rows.view(self._rows.base, self._rows.stop)[:] = kept[:, 1:]

    def forget(self) -> None:
        """Begin anew at another time."""
        self._rows = None
