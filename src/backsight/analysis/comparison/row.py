"""What the comparison says of one estimator."""

import dataclasses
import math

from backsight.analysis.comparison.virtual_outputs import VirtualOutput
from backsight.analysis.consistency import Consistency
from backsight.analysis.forces import FittedHit, FoundHits
from backsight.analysis.outliers import Outliers
from backsight.description import Printed
from backsight.rounding import between, plus_minus


@dataclasses.dataclass(frozen=True)
class Final(Printed):
    """Last estimate of one state [unit], and the reference value it is held against, if any."""

    value: float
    std: float
    unit: str
    reference: float | None = None
    band: tuple[float, float] | None = None
    """Ends of the band of one standard deviation of a state that is estimated as a logarithm."""

    @property
    def shown(self) -> str:
        """Value and band in words; with its ends where the two sides differ to the eye."""
        if self.band is not None and self.std > 0.05 * abs(self.value):
            return between(self.value, *self.band)
        return plus_minus(self.value, self.std)

    @property
    def error(self) -> float:
        """Value minus reference; ``NaN`` without a reference."""
        return math.nan if self.reference is None else self.value - self.reference

    @property
    def relative_error(self) -> float:
        """Error per magnitude of the reference; ``NaN`` if that is zero or unknown."""
        return self.error / abs(self.reference) if self.reference else math.nan

    @property
    def deviations(self) -> float:
        """Error in standard deviations of the estimate, not negative."""
        return abs(self.error) / self.std if self.std > 0 else math.nan


@dataclasses.dataclass(frozen=True)
class Row(Printed):
    """What the comparison table says of one estimator.

    Parameters
    ----------
    estimator : str
        Its name in the comparison.
    samples : int
        Number of samples of the recording.
    log_likelihood : float
        Mean logarithm of the density of the innovations, per measured sample.
    mean_nis, nis_expected : float
        Mean normalised innovation squared and its expectation.
    nis_band : (float, float)
        95 % interval of the mean NIS of a consistent estimator.
    consistency : Consistency
        How the result agrees with its own covariances.
    rms_innovation, rms_error : dict
        Per output [its unit]; per state against the truth [its unit], empty if that is unknown.
    final : dict
        Last estimate per state.
    alignment : tuple of str
        What was found out about the times and units of the recording, a sentence each.
    aligned : bool or None
        Whether outputs and inputs belong to the same samples; None if that is not known.
    us_per_sample : float
        Computing time [us]; ``NaN`` if it was not measured.
    status : dict
        Number of samples for every `Status` that occurs, "OK" included.
    failed : bool
        Whether the estimates are worthless: the filter diverged.
    remarks : tuple of str
        What else is to be said of the result, a sentence each.
    hits : Hits or None
        Unknown forces that were found; None if the estimator does not look for any.
    fitted_hits : tuple of FittedHit
        Hits that were fitted as pulses, in the order of time.
    outliers : tuple of Outliers
        What a rule for outliers did, per output; empty if there was none.
    coarse : str
        Why the integration step is too coarse; empty if it is not.
    doubts : tuple of str
        Which parameters the recording hardly tells, or not from an unknown force, a sentence each.
    virtual : dict
        Quantities without a sensor, by name.
    """

    estimator: str
    samples: int
    log_likelihood: float
    mean_nis: float
    nis_expected: float
    nis_band: tuple[float, float]
    consistency: Consistency
    rms_innovation: dict[str, float]
    rms_error: dict[str, float]
    final: dict[str, Final]
    alignment: tuple[str, ...]
    aligned: bool | None
    us_per_sample: float
    status: dict[str, int]
    failed: bool
    remarks: tuple[str, ...] = ()
    hits: FoundHits | None = None
    fitted_hits: tuple[FittedHit, ...] = ()
    outliers: tuple[Outliers, ...] = ()
    coarse: str = ""
    doubts: tuple[str, ...] = ()
    virtual: dict[str, VirtualOutput] = dataclasses.field(default_factory=dict)
