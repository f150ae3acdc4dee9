"""How well sparse forces were found: place, moment, size, and what was found but is not there."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backsight.description import Printed, checked
from backsight.errors import DataError
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class ForceErrors(Printed):
    """Found forces beside true ones.

    Parameters
    ----------
    hits : int
        True forces that were found.
    missed : int
        True forces that were not.
    false_alarms : int
        Found forces that are none.
    magnitude : float
        Mean relative error of the size of the true forces that were found; ``NaN`` if none was.
    pairs : tuple of ((int, int), (int, int))
        (step, place) of every true force that was found, and where it was found.
    """

    hits: int
    missed: int
    false_alarms: int
    magnitude: float
    pairs: tuple[tuple[tuple[int, int], tuple[int, int]], ...]

    @property
    def precision(self) -> float:
        """Share of the found forces that are there; 1 if nothing was found."""
        return _share(self.hits, self.hits + self.false_alarms)

    @property
    def recall(self) -> float:
        """Share of the true forces that were found; 1 if there are none."""
        return _share(self.hits, self.hits + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall: 1 if all is found and nothing else."""
        return _share(2 * self.hits, 2 * self.hits + self.missed + self.false_alarms)

    @property
    def exact(self) -> bool:
        """Whether all true forces were found and nothing else."""
        return not self.missed and not self.false_alarms


@checked(DataError)
def compare_forces(
    found: ArrayLike, true: ArrayLike, *, least: float = 0.0, steps: int = 0, places: int = 0
) -> ForceErrors:
    """Compare forces over time and place with the true ones.

    Every true force is paired with at most one found force, of the same direction, the closest
    first; of two that are equally close, the larger.

    Parameters
    ----------
    found, true : (time, force) arrays
        Zero where there is no force. Places next to each other are neighbouring columns.
    least : float
        Found forces that are smaller than this do not count [unit of the force].
    steps, places : int
        How far a force may be off and still be found.

    Returns
    -------
    ForceErrors

    Raises
    ------
    DataError
        If the shapes differ, or a number is negative.

    Examples
    --------
    >>> true, found = [[0.0], [5.0], [0.0], [0.0]], [[0.0], [0.0], [4.5], [0.0]]
    >>> errors = bs.forces.compare_forces(found, true)
    >>> errors.hits, errors.missed, errors.false_alarms
    (0, 1, 1)
    """
    d, truth = np.nan_to_num(np.asarray(found, float)), np.asarray(true, float)
    if d.ndim != 2 or d.shape != truth.shape:
        raise DataError(
            f"the found forces have the shape {d.shape}, the true ones {truth.shape}; both must be "
            "(time, force)"
        )
    if least < 0 or steps < 0 or places < 0:
        raise DataError(
            f"least = {least:g}, steps = {steps}, places = {places}: none of them may be negative"
        )
    here = np.argwhere((d != 0) & (np.abs(d) >= least))
    there = np.argwhere(truth != 0)
    pairs = _paired(here, there, d, truth, reach=(steps, places))
    errors = [abs(d[h] - truth[t]) / abs(truth[t]) for t, h in pairs]
    return ForceErrors(
        hits=len(pairs),
        missed=len(there) - len(pairs),
        false_alarms=len(here) - len(pairs),
        magnitude=float(np.mean(errors)) if errors else math.nan,
        pairs=tuple(pairs),
    )


Place = tuple[int, int]
"""Step and number of the force."""


def _paired(
    here: NDArray[np.intp], there: NDArray[np.intp], found: Array, true: Array, *, reach: Place
) -> list[tuple[Place, Place]]:
    candidates = []
    for k, j in there.tolist():
        for i, m in here.tolist():
            apart = abs(i - k), abs(m - j)
            close = apart[0] <= reach[0] and apart[1] <= reach[1]
            if close and found[i, m] * true[k, j] > 0:
                candidates.append((sum(apart), -abs(found[i, m]), (k, j), (i, m)))
    pairs: list[tuple[Place, Place]] = []
    for *_, t, h in sorted(candidates):
        if all(t != a and h != b for a, b in pairs):
            pairs.append((t, h))
    return sorted(pairs)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 1.0
