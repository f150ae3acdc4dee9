r"""How a constant follows settings, found from its values at a few settings.

Nearly all that a program makes of a number is one of

.. math:: c = k\, s_i^p, \qquad c = k\, s_i^p\, s_j^q, \qquad c = a + k\, s_i :

a variance and its factor, a covariance, a weight and its inverse, a bound with a margin. Which one
it is follows from three values: two would fit a line, the third one tells. The settings are such
that no two of these agree by chance.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backsight.types import Array

ROUNDING = 1e-11
"""Share of a constant that is rounding."""

POWERS = (1.0, 2.0, -1.0, -2.0, 0.5, -0.5, 3.0, 4.0, -3.0, -4.0)
"""Of a setting alone."""

POWERS_OF_TWO = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
"""Of two settings."""


@dataclasses.dataclass(frozen=True)
class Rule:
    """A constant as ``offset + factor * product of settings[i] ** power``.

    Parameters
    ----------
    factor : float
    powers : tuple of (int, float)
        Places of settings, and their powers.
    offset : float
    """

    factor: float
    powers: tuple[tuple[int, float], ...]
    offset: float = 0.0

    def at(self, settings: Any) -> Any:
        """Value at settings: numbers, or symbols of CasADi."""
        product = self.factor
        for place, power in self.powers:
            s = settings[place]
            match power:
                case 1.0:
                    product = product * s
                case -1.0:
                    product = product / s
                case _:
                    product = product * s**power
        return product + self.offset if self.offset else product


class Rules:
    """Finds the rules of constants.

    Parameters
    ----------
    settings : (3, n) array
        Three choices of the settings, none of them zero.
    """

    def __init__(self, settings: Array) -> None:
        self._settings = settings
        n = settings.shape[1]
        self._powers = [((i, p),) for i in range(n) for p in POWERS]
        self._powers += [
            ((i, p), (j, q))
            for i, j in itertools.combinations(range(n), 2)
            for p, q in POWERS_OF_TWO
        ]
        with np.errstate(invalid="ignore"):  # the root of a negative number is no candidate
            found = [np.prod([settings[:, i] ** p for i, p in k], axis=0) for k in self._powers]
        self._products = np.nan_to_num(np.array(found), nan=np.inf)

    def rule(self, values: Sequence[float]) -> Rule | None:
        """Return the rule that gives these values at the three choices, None if there is none."""
        c = np.asarray(values, float)
        if not np.isfinite(c).all() or not c.all():
            return self._line(c)
        with np.errstate(over="ignore", invalid="ignore"):
            factors = c / self._products
            off = np.ptp(factors, axis=1) / np.abs(factors).max(axis=1)
        off[~np.isfinite(off)] = np.inf
        best = int(np.argmin(off))
        if off[best] < ROUNDING:
            return Rule(float(factors[best].mean()), self._powers[best])
        return self._line(c)

    def _line(self, c: NDArray[np.float64]) -> Rule | None:
        """``a + k s_i``."""
        if not np.isfinite(c).all():
            return None
        for i, s in enumerate(self._settings.T):
            k = (c[1] - c[0]) / (s[1] - s[0])
            a = c[0] - k * s[0]
            if abs(a + k * s[2] - c[2]) <= ROUNDING * (abs(a) + abs(k * s[2])):
                return Rule(float(k), ((i, 1.0),), float(a))
        return None
