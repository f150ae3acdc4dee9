r"""Samples that do not belong: how much the update may believe of a surprising measurement.

Before a sample enters, every estimator knows the innovation :math:`e` of each channel and its
variance :math:`S`. A rule turns the squared ratio :math:`z^2 = e^2 / S` into a weight :math:`w`:
the noise of this channel of this sample is taken as :math:`\sigma_y / w`, and the channel is left
out where w is 0. Covariances follow the weights.
"""

import abc
import dataclasses
from typing import Annotated

import casadi as ca
import numpy as np
import scipy

from backsight.description import Called, Description, Positive, Range
from backsight.estimators.varied_number import varied_at

DOUBTED = 0.5
"""A weight below this counts as an outlier: its noise is taken at least twice as large."""

SHARE = 0.5
"""A rule opens for a channel of whose latest samples more than this share are outliers."""

Likely = Annotated[float, Range("be from 0.5 to below 1", 0.5, 1 - 1e-15), Called("probability")]
Patience = Annotated[int, Range("be a whole number from 2 on", 2), Called("patience")]


@dataclasses.dataclass(frozen=True)
class AbstractOutlierRule(Description, abc.ABC):
    """A weight for every channel of a sample, by the size of its innovation.

    Parameters
    ----------
    patience : int
        Samples over which outliers of a channel are averaged (exponentially). If more than half
        are outliers it is the estimate that is wrong: the rule opens for the channel, its samples
        count in full and the status says *gate open*, until they fit again. A channel of which
        every sample is an outlier is taken in again after 0.7 times `patience`.
    """

    patience: Patience = dataclasses.field(default=20, kw_only=True)

    @property
    @abc.abstractmethod
    def threshold(self) -> float:
        """Standard deviations of the innovation beyond which a sample counts as an outlier."""

    @property
    def varied_settings(self) -> tuple[str, ...]:
        """Settings that may be inputs, see `backsight.estimators.varied_number`."""
        return ()

    @property
    def leaves_out(self) -> bool:
        """Whether a weight is 0 or 1, never between."""
        return False

    @abc.abstractmethod
    def weight(self, z2: ca.SX, u: ca.SX) -> ca.SX:
        """Weights of squared normalised innovations (ny,), each from 0 to 1, at inputs (nu,).

        Inputs matter only where they are settings, see `backsight.estimators.varied_number`.
        """


@dataclasses.dataclass(frozen=True)
class Gate(AbstractOutlierRule):
    r"""Chi-square gate: a channel whose innovation is too large is left out.

    .. math:: w = 1 \text{ if } e^2 / S \le \chi^2_1(\text{probability}), \text{ else } 0

    Parameters
    ----------
    probability : float
        Share of the samples without outliers that pass, from 0.5 to below 1.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001,
    doi:10.1002/0471221279, section 5.4.

    Examples
    --------
    >>> bs.Noise(sigma_y=1e-3, outliers=bs.settings.Gate(probability=0.99)).outliers.patience
    20
    """

    probability: Likely = 0.999

    @property
    def threshold(self) -> float:
        """See `AbstractOutlierRule.threshold`."""
        return float(scipy.special.ndtri(0.5 + 0.5 * self.probability))

    @property
    def leaves_out(self) -> bool:
        """See `AbstractOutlierRule.leaves_out`."""
        return True

    def weight(self, z2: ca.SX, u: ca.SX) -> ca.SX:
        """See `AbstractOutlierRule.weight`."""
        del u
        return ca.if_else(z2 > self.threshold**2, 0, 1)


@dataclasses.dataclass(frozen=True)
class StudentT(AbstractOutlierRule):
    r"""Noise with the heavy tails of Student's t: the further off, the less it counts.

    .. math:: w^2 = \min\left(1, \frac{\nu + 1}{\nu + e^2 / S}\right)

    The weight is that of the expectation step for t-distributed innovations; it is not raised
    above 1 for small ones.

    Parameters
    ----------
    nu : float
        Degrees of freedom: 1 is a Cauchy distribution, many are a Gaussian.

    References
    ----------
    Lange, Little, Taylor, "Robust statistical modeling using the t distribution", 1989, Journal
    of the American Statistical Association 84, doi:10.1080/01621459.1989.10478852.

    Examples
    --------
    >>> bs.Noise(sigma_y=1e-3, outliers=bs.settings.StudentT(nu=3.0)).outliers.nu
    3.0
    """

    nu: Positive = 4.0

    @property
    def varied_settings(self) -> tuple[str, ...]:
        """See `AbstractOutlierRule.varied_settings`."""
        return ("nu",)

    @property
    def threshold(self) -> float:
        """See `AbstractOutlierRule.threshold`."""
        return float(np.sqrt((self.nu + 1) / DOUBTED**2 - self.nu))

    def weight(self, z2: ca.SX, u: ca.SX) -> ca.SX:
        """See `AbstractOutlierRule.weight`."""
        nu = varied_at(self.nu, u)
        return ca.fmin(1, ca.sqrt((nu + 1) / (nu + z2)))


@dataclasses.dataclass(frozen=True)
class Huber(AbstractOutlierRule):
    r"""Huber's function: beyond k standard deviations a sample's pull grows no more.

    .. math:: w^2 = \min\left(1, \frac{k}{|e| / \sqrt{S}}\right)

    Parameters
    ----------
    k : float
        Where the weight begins to fall [standard deviations of the innovation].

    References
    ----------
    Huber, "Robust estimation of a location parameter", 1964, doi:10.1214/aoms/1177703732.
    Karlgaard, Schaub, "Huber-based divided difference filtering", 2007, doi:10.2514/1.27968.

    Examples
    --------
    >>> bs.Noise(sigma_y=1e-3, outliers=bs.settings.Huber()).outliers.k
    1.345
    """

    k: Positive = 1.345

    @property
    def varied_settings(self) -> tuple[str, ...]:
        """See `AbstractOutlierRule.varied_settings`."""
        return ("k",)

    @property
    def threshold(self) -> float:
        """See `AbstractOutlierRule.threshold`."""
        return self.k / DOUBTED**2

    def weight(self, z2: ca.SX, u: ca.SX) -> ca.SX:
        """See `AbstractOutlierRule.weight`."""
        k = varied_at(self.k, u)
        return ca.sqrt(k / ca.fmax(k, ca.sqrt(z2)))
