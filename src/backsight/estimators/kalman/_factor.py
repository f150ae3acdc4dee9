"""The lower factor of a covariance, as the unscented Kalman filter keeps it."""

import dataclasses

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import vech
from backsight.estimators.parts.covariance import Covariance, Term, packed
from backsight.estimators.parts.factors import cholesky
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Factor:
    """How the lower factor of a covariance is kept, and 1 behind it if a prediction had none.

    Parameters
    ----------
    like : Covariance
    """

    like: Covariance

    @property
    def size(self) -> int:
        """How many numbers are kept."""
        return self.like.size + 1

    def of(self, L: Array) -> Array:
        """A factor in numbers as it is kept, without the last entry."""
        return L.ravel(order="F") if self.like.whole else packed(L)

    def opened(self, spread: Term) -> Term:
        """The factor (n, n)."""
        L = self.like.opened(spread[:-1])
        return L if self.like.whole else ca.tril(L)

    def closed(self, L: Term) -> Term:
        """A factor (n, n) as it is kept, without the last entry."""
        return ca.vec(L) if self.like.whole else vech(ca.densify(L))


def cholesky_factor(P: Array) -> Array:
    """Lower factor of a positive semidefinite matrix in numbers."""
    A = ca.MX(ca.DM(P)) if Covariance(len(P)).whole else ca.SX(ca.DM(P))
    return np.asarray(ca.evalf(ca.densify(cholesky(A))))
