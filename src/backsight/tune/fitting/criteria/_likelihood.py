"""The likelihood of innovations, and that of predictions of what the estimator does not see."""

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import ClassVar

import numpy as np

from backsight.description import Count, Share, Sound
from backsight.errors import TuningError
from backsight.tune.fitting.criteria._base import BLOCKS, AbstractCriterion, Measure, Piece
from backsight.types import Array, Mask


@dataclasses.dataclass(frozen=True)
class Likelihood(AbstractCriterion):
    r"""Likelihood of the innovations, of Kalman filters that of the recording.

    .. math::
        J = \tfrac12 \sum \left(\frac{r^2}{d} + \ln d + \ln 2\pi\right)

    Its gradient and its information matrix (Fisher) follow from the derivatives of r and d:

    .. math::
        \frac{\partial J}{\partial\theta} = \sum \frac{r r'}{d}
            + \frac{d'}{2 d}\left(1 - \frac{r^2}{d}\right), \qquad
        I_{ij} = \sum \frac{r'_i r'_j}{d} + \frac{d'_i d'_j}{2 d^2} .

    With a share :math:`\epsilon` of outliers, which lie anywhere in the range w of what was
    measured, a term is :math:`-\ln((1 - \epsilon)\,N(r; 0, d) + \epsilon / w)`: what is surely an
    outlier decides nothing, and its derivatives are weighted by how surely it is none.

    Parameters
    ----------
    outliers : float
        Share of outliers; `fit` takes 0.02 if the noise has a rule for outliers.

    References
    ----------
    Schweppe, "Evaluation of likelihood functions for Gaussian signals", 1965,
    doi:10.1109/TIT.1965.1053737.

    Examples
    --------
    >>> bs.tune.Likelihood().outliers
    0.0
    """

    outliers: Share = 0.0

    def residuals(self, z: Array) -> Array:
        """See `AbstractCriterion`; the likelihood is more than these."""
        return z[np.isfinite(z)]

    def measure(self, pieces: Iterable[Piece], step: float) -> Measure:
        """See `AbstractCriterion.measure`."""
        found = [self._of(piece, step) for piece in pieces]
        return Measure(
            sum(m.cost for m in found),
            sum((m.gradient for m in found[1:]), found[0].gradient),
            sum((m.curvature for m in found[1:]), found[0].curvature),
            np.concatenate([m.scores for m in found]),
        )

    def _of(self, piece: Piece, step: float) -> Measure:
        p, w = len(piece.r) - 1, piece.judged
        r, d = (np.where(w, a, b) for a, b in ((piece.r, 0.0), (piece.d, 1.0)))
        if not (np.isfinite(r).all() and np.isfinite(d).all() and (d > 0).all()):
            return Measure.failed(p)
        log_d = np.log(d)
        z2 = r[0] ** 2 / d[0]
        terms = 0.5 * (z2 + log_d[0] + math.log(2 * math.pi))
        sure = np.ones_like(z2)
        if self.outliers:
            own, other = math.log1p(-self.outliers) - terms, np.log(self.outliers / piece.width)
            terms = -np.logaddexp(own, other)
            sure = np.exp(own + terms)
        cost = float(np.sum(terms * w))
        z = r[0] / np.sqrt(d[0])
        dr = (r[1:] - r[0]) / step / np.sqrt(d[0])
        dl = (log_d[1:] - log_d[0]) / step
        score = (sure * (z * dr + 0.5 * (1 - z2) * dl)).sum(axis=2)
        a, b = (k.reshape(p, z.size) for k in (dr * np.sqrt(sure), dl * np.sqrt(sure)))
        curvature = a @ a.T + 0.5 * b @ b.T
        length = max(1, score.shape[1] // BLOCKS)
        scores = np.add.reduceat(score, np.arange(0, score.shape[1], length), axis=1).T
        return Measure(cost, scores.sum(axis=0), curvature, scores)


@dataclasses.dataclass(frozen=True)
class Prediction(Likelihood):
    """Likelihood of predictions over several samples, in blocks that the estimator does not see.

    What matters to a simulation or a controller is how the model goes on by itself. Every block of
    `ahead` samples is hidden and predicted from what lies before it, then the estimator sees
    `every` - `ahead` samples again. Errors within a block follow from each other; the standard
    deviations of the tuned values know of that.

    Parameters
    ----------
    ahead : int
        Samples of a block.
    every : int, optional
        Samples from block to block; three blocks if not given.

    Examples
    --------
    >>> bs.tune.Prediction().outliers
    0.0
    """

    independent: ClassVar[bool] = False

    ahead: Count = 10
    every: Count | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("every", "ahead") and self.every is not None and self.every <= self.ahead:
            yield f"every = {self.every} leaves nothing to see between blocks of {self.ahead}"

    def hidden(self, samples: int) -> Mask:
        """See `AbstractCriterion`."""
        every = self.every or 3 * self.ahead
        if samples < every:
            raise TuningError(
                f"the recording has {samples} samples; a block and what is before it {every}"
            )
        return np.arange(samples) % every >= every - self.ahead


@dataclasses.dataclass(frozen=True)
class Simulation(Likelihood):
    """Likelihood of a simulation of the whole recording, which no measurement corrects.

    For parameters with which the model shall simulate: there is no process noise, and the start is
    the one that is given, or free (`x0`). `sigma_y` is then what the simulation misses. Its errors
    follow from each other; the standard deviations of the tuned values know of that.

    References
    ----------
    Ljung, "System Identification: Theory for the User", 1999, chapter 3.

    Examples
    --------
    >>> bs.tune.Simulation().simulates
    True
    """

    independent: ClassVar[bool] = False
    simulates: ClassVar[bool] = True
