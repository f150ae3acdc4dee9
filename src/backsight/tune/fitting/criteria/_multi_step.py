r"""How well the model goes on by itself from the estimates: squares of predictions far ahead."""

import dataclasses
import math
from collections.abc import Iterable
from typing import ClassVar, Self

import numpy as np

from backsight.description import Count
from backsight.discrete.modes import modes_at
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.tune.fitting.criteria._base import BLOCKS, AbstractCriterion, Measure, Piece
from backsight.types import Array

USUAL, MOST = 20, 200
"""Samples ahead of a model that does not oscillate, and at most."""


@dataclasses.dataclass(frozen=True)
class MultiStep(AbstractCriterion):
    r"""Squares of predictions over several samples, from every estimate by the model alone.

    .. math:: J = \sum_j \frac{n_j}{2} \ln \frac{1}{n_j} \sum_k
        \left(y_j(k + m) - \hat y_j(k + m \mid k)\right)^2

    over the outputs j with n measurements each, m samples ahead. A parameter that is wrong shows
    in the course of the next oscillation, not in the next sample; and as in the mean square error
    of an estimate it is the large errors that count. It trusts no covariance, which makes it the
    one for the weights of windows, whose covariances are not those of their errors.

    Parameters
    ----------
    ahead : int, optional
        Samples m; one period of the slowest oscillation of the model at the prior's mean if not
        given, 20 if there is none.

    References
    ----------
    Farina, Piroddi, "Simulation error minimization identification based on multi-stage prediction",
    2011, International Journal of Adaptive Control and Signal Processing 25,
    doi:10.1002/acs.1203.

    Examples
    --------
    >>> bs.tune.MultiStep(ahead=25).ahead
    25
    """

    independent: ClassVar[bool] = False

    ahead: Count | None = None

    @property
    def alone(self) -> int:
        """See `AbstractCriterion.alone`."""
        if self.ahead is None:
            raise TuningError("MultiStep: how far ahead is decided by `fitted`")
        return self.ahead

    def fitted(self, estimator: AbstractEstimator, model: Model, dt: float) -> Self:
        """See `AbstractCriterion.fitted`."""
        if self.ahead is not None:
            return self
        if not model.continuous:
            return dataclasses.replace(self, ahead=USUAL)
        # The observer's own modes, which `estimator.modes` may have, are no oscillation of it.
        prior = estimator.assumed[1]
        values = modes_at(model, prior.mean(model)[None], np.zeros((1, model.nu))).values
        rates = np.abs(values.imag)[np.abs(values.imag) > 0.1 * np.abs(values)]
        period = 2 * math.pi / float(rates.min()) / dt if len(rates) else USUAL
        return dataclasses.replace(self, ahead=max(2, min(round(period), MOST)))

    def residuals(self, z: Array) -> Array:
        """See `AbstractCriterion`; their squares count as a share of their mean."""
        return z[np.isfinite(z)]

    def measure(self, pieces: Iterable[Piece], step: float) -> Measure:
        """See `AbstractCriterion.measure`."""
        parts = [(piece.r, piece.judged) for piece in pieces]
        r, judged = np.concatenate([k[0] for k in parts], axis=1), np.vstack([k[1] for k in parts])
        p = len(r) - 1
        r = np.where(judged, r, 0.0)
        if not np.isfinite(r).all():
            return Measure.failed(p)
        count = judged.sum(axis=0)
        power = (r[0] ** 2).sum(axis=0) / np.maximum(count, 1)
        seen = (count > 0) & (power > 0)
        r, count, power = r[:, :, seen], count[seen], power[seen]
        cost = float(0.5 * count @ np.log(power))
        slope = (r[1:] - r[0]) / step / np.sqrt(power)
        score = (r[0] / np.sqrt(power) * slope).sum(axis=2)
        flat = slope.reshape(p, r[0].size)
        # Errors so many samples ahead follow from each other: blocks are longer than that.
        length = max(3 * self.alone, score.shape[1] // BLOCKS)
        scores = np.add.reduceat(score, np.arange(0, score.shape[1], length), axis=1).T
        return Measure(cost, scores.sum(axis=0), flat @ flat.T, scores)
