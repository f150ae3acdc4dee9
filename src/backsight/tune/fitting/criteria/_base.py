r"""What makes settings good, judged by the recording alone.

An estimator predicts every measurement before it sees it. All criteria look at these predictions:
the innovations :math:`r`, independent within a sample, with their variances :math:`d`, or what they
are in standard deviations, :math:`z = r / \sqrt d`. With the true settings z is white and has
variance one.
"""

import abc
import dataclasses
import math
from collections.abc import Iterable
from typing import ClassVar, Self

import numpy as np

from backsight.description import Description
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.types import Array, Mask

BLOCKS = 100
"""Parts of a piece whose scores count as independent, at least."""


@dataclasses.dataclass(frozen=True)
class Piece:
    """Innovations of some samples of a recording with several settings, a lane each.

    Parameters
    ----------
    r, d : (lanes, n, ny) arrays
        Innovations, and their variances. Lane 0 has the settings themselves, lane i those with a
        step in the i-th value.
    judged : (n, ny) array of bool
        What counts.
    width : (ny,) array
        Range of what was measured in the recording.
    """

    r: Array
    d: Array
    judged: Mask
    width: Array

    @property
    def z(self) -> Array:
        """Innovations in standard deviations; NaN where they do not count."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.judged, self.r / np.sqrt(self.d), np.nan)


@dataclasses.dataclass(frozen=True)
class Measure:
    """A criterion at some settings: the smaller, the better.

    Parameters
    ----------
    cost : float
    gradient : (p,) array
    curvature : (p, p) array
        Expected second derivative, positive semidefinite.
    scores : (m, p) array
        Gradients of parts of the recording whose sum is `gradient`; empty where a criterion is no
        sum over samples.
    """

    cost: float
    gradient: Array
    curvature: Array
    scores: Array

    @staticmethod
    def failed(p: int) -> "Measure":
        """Of settings with which the estimator diverges."""
        return Measure(math.inf, np.zeros(p), np.eye(p), np.zeros((0, p)))


class AbstractCriterion(Description, abc.ABC):
    r"""A criterion: half the sum of the squares of its residuals.

    Those of one's own are made by deriving a frozen dataclass with a method `residuals`. A residual
    should have standard deviation one with the true settings: the standard deviations of the tuned
    values follow from that.

    Examples
    --------
    >>> import numpy as np
    >>> class Size(bs.tune.AbstractCriterion):
    ...     def residuals(self, z):
    ...         return np.array([np.nanmean(z**2) - 1.0])
    >>> Size().independent
    True
    """

    independent: ClassVar[bool] = True
    """Whether what it sums up is independent from sample to sample if everything is right."""
    simulates: ClassVar[bool] = False
    """Whether no measurement corrects the estimate."""

    def hidden(self, samples: int) -> Mask:
        """Which samples are kept from the estimator, (samples,) of bool; none by default."""
        return np.zeros(samples, bool)

    @property
    def alone(self) -> int:
        """Samples over which the model runs by itself from every estimate before it is judged.

        0, by default, judges the innovations.
        """
        return 0

    def fitted(self, estimator: AbstractEstimator, model: Model, dt: float) -> Self:
        """The criterion with what it leaves open, for an estimator; itself by default."""
        del estimator, model, dt
        return self

    @abc.abstractmethod
    def residuals(self, z: Array) -> Array:
        """Residuals (m,) of a recording.

        Parameters
        ----------
        z : (n, ny) array
            Innovations in standard deviations, NaN where nothing was measured; where samples are
            hidden, only these.
        """

    def measure(self, pieces: Iterable[Piece], step: float) -> Measure:
        """Cost and derivatives of a recording in pieces, by the differences of the lanes."""
        parts = [piece.z for piece in pieces]
        z = np.concatenate(parts, axis=1)
        found = np.array([self.residuals(lane) for lane in z])
        if found.ndim != 2 or not np.isfinite(found).all():
            return Measure.failed(len(z) - 1)
        J = (found[1:] - found[0]).T / step
        cost = 0.5 * float(found[0] @ found[0])
        return Measure(cost, J.T @ found[0], J.T @ J, np.zeros((0, len(z) - 1)))
