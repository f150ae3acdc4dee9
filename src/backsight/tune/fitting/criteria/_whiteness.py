"""Innovations that do not follow from each other."""

import dataclasses
import math

import numpy as np

from backsight.description import Count
from backsight.tune.fitting.criteria._base import AbstractCriterion
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Whiteness(AbstractCriterion):
    """Innovations that do not follow from each other and are as large as predicted.

    The residuals are the autocorrelations of every output, in their standard deviations, and the
    mean square. It needs no trust in the shape of the noise; it is less exact than the likelihood.

    Parameters
    ----------
    lags : int
        Samples up to which innovations must not be correlated.

    Examples
    --------
    >>> bs.tune.Whiteness(lags=5).lags
    5
    """

    lags: Count = 20

    def residuals(self, z: Array) -> Array:
        """See `AbstractCriterion`."""
        found = []
        for column in z.T:
            seen = np.isfinite(column)
            x, n = np.where(seen, column, 0.0), max(int(seen.sum()), 1)
            power = float(x @ x) / n
            found.append(math.sqrt(n / 2) * (power - 1))
            if power > 0:
                found += [
                    float(x[lag:] @ x[:-lag]) / (power * math.sqrt(n))
                    for lag in range(1, min(self.lags + 1, len(x)))
                ]
        return np.array(found)
