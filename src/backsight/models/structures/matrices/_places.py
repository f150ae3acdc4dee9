"""Places on a structure: a coordinate by number or name, or weights of several."""

import dataclasses
import functools
import re
from collections import Counter
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.errors import ModelError, nearest
from backsight.types import Array, Sparse

Place: TypeAlias = int | str | Mapping[int | str, float] | ArrayLike
"""A coordinate by its number, from 0 on, or its name; coordinates to weights; or all weights."""

_FORMULA = re.compile(r"[*^=]|\w\s*[-+]\s*[A-Za-z(]")
"""Signs of a formula, which a place has none of."""

CANCELLED = 1e-9
"""A weighted sum of deflections below this share of its terms is the rounding of zero."""

STILL = 1e-12
"""A deflection by mass below this is the rounding of a vibration node."""


@dataclasses.dataclass(frozen=True)
class Places:
    """The coordinates of a structure.

    Parameters
    ----------
    n : int
        How many there are.
    names : tuple of str
        Their names, or none.
    """

    n: int
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.names and len(self.names) != self.n:
            raise ModelError(
                f"{len(self.names)} coordinates are named, but the matrices have {self.n} rows"
            )
        if len(self._numbers) < len(self.names):
            twice = Counter(self.names).most_common(1)[0][0]
            raise ModelError(f"two coordinates are called '{twice}'")

    @functools.cached_property
    def _numbers(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def number(self, place: int | str, what: str) -> int:
        """Return the number of a coordinate; `what` begins the message if there is none."""
        if isinstance(place, str) and place.isdecimal() and not self.names:
            place = int(place)  # keys of tables in problem files are texts
        if isinstance(place, str):
            found = self._numbers.get(place)
            if found is None:
                _refuse_formula(place, what)
                hint = nearest(place, self.names) if self.names else "they have no names"
                raise ModelError(f"{what} is at the coordinate '{place}': {hint}")
            return found
        if not isinstance(place, int | np.integer) or isinstance(place, bool):
            raise ModelError(f"{what} is at {place!r}; give the number or name of a coordinate")
        if not 0 <= place < self.n:
            raise ModelError(f"{what} is at coordinate {place}; there are 0 to {self.n - 1}")
        return int(place)

    def weights(self, place: Place, what: str) -> Sparse:
        """Return the weight of every coordinate, (n, 1)."""
        if isinstance(place, int | np.integer | str):
            single: int | str = place if isinstance(place, str) else int(place)
            place = {single: 1.0}
        if isinstance(place, Mapping):
            _refuse_formula(place.get("expression"), what)
            rows = [self.number(at, what) for at in place]
            values = np.array([_weight(value, what) for value in place.values()])
            entries = (values, (rows, np.zeros(len(rows), int)))
            return scipy.sparse.csc_array(entries, shape=(self.n, 1))
        try:
            values = np.asarray(place, float)
        except (TypeError, ValueError):
            raise ModelError(f"{what} is neither a coordinate nor a list of weights") from None
        if values.shape != (self.n,):
            raise ModelError(
                f"{what} has {values.shape} weights; {self.n} coordinates need ({self.n},)"
            )
        if not np.isfinite(values).all():
            raise ModelError(f"{what} has a weight that is not finite")
        return scipy.sparse.csc_array(values[:, None])


def _refuse_formula(given: object, what: str) -> None:
    """Raise `ModelError` if what should be a place or a weight is a formula."""
    if isinstance(given, str) and _FORMULA.search(given):
        raise ModelError(
            f"{what} is given the formula '{given}'; here stands where it acts, and its size is "
            "unknown as a whole. A force by a formula with unknown parameters belongs to the "
            "equations of motion (kind = 'equations', from_equations)"
        )


def _weight(given: object, what: str) -> float:
    _refuse_formula(given, what)
    if not isinstance(given, int | float | np.number) or not np.isfinite(given):
        raise ModelError(f"{what} has the weight {given!r}; it must be a finite number")
    return float(given)


def deflection(weights: Sparse, shapes: Array, mass: Array) -> Array:
    """Shapes (modes,) under weights; what is rounding beside its terms is zero.

    Parameters
    ----------
    weights : (n, 1) sparse array
    shapes : (n, modes) array
        By mass.
    mass : (n,) array
        Diagonal of the mass matrix: rounding of a shape is relative to motion by mass.
    """
    row = (weights.T @ shapes).ravel()
    terms = (abs(weights).T @ np.abs(shapes)).ravel()
    own = np.divide(1.0, np.sqrt(mass), out=np.zeros(len(mass)), where=mass > 0)
    rounding = CANCELLED * terms
    if weights.nnz > 1:
        return np.where(np.abs(row) > rounding, row, 0.0)
    return np.where(np.abs(row) > STILL * float((abs(weights).T @ own).item()), row, 0.0)
