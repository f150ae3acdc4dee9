"""Settings of the paper, and how its text can be read."""

import dataclasses
import math

from backsight.estimators.arrival import SmoothedArrival
from backsight.estimators.cs_mhe import Carryover, CompressiveSensingMHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight_studies.beam.plant import FORCES, THICKNESS, N, sampled

EPS_R = math.exp(5) * 1e-10
"""Variance of the sensors in Table 3 [m2]; all values of the table are powers of e."""

THRESHOLD = 1.0
"""Smallest force that counts [N], Table 1."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """Weights of the cost.

    Parameters
    ----------
    eps_Q : float
        Variance of the forces in the background [N2].
    lam : float
        Weight of the l1 norm [1/N].
    eps_R : float
        Variance of the sensors [m2].
    """

    eps_Q: float
    lam: float
    eps_R: float = EPS_R


TABLE = {
    0.0: Setting(math.exp(2) * 1e-2, math.exp(15) * 1e-10),
    -3.3: Setting(math.exp(5) * 1e-2, math.exp(19.5) * 1e-10),
    -6.7: Setting(math.exp(11) * 1e-2, math.exp(14.5) * 1e-10),
    -10.0: Setting(math.exp(11) * 1e-2, math.exp(15) * 1e-10),
}
"""Mismatch to the values of Table 3."""

TUNED = Setting(math.exp(11) * 1e-2, math.exp(16) * 1e-10)
"""One setting for all mismatches, the best for the largest."""

SETTINGS = {"Table 3": TABLE, "one setting": dict.fromkeys(THICKNESS, TUNED)}

NO_CARRYOVER, READING_1, READING_2, READING_3 = (
    "no carryover",
    "reading I",
    "reading II",
    "reading III",
)

CARRYOVERS = {
    NO_CARRYOVER: None,
    READING_1: Carryover((0.1, 1.0), "prior"),
    READING_2: Carryover((100.0, 1000.0), "release"),
    READING_3: Carryover((100.0, 1000.0), "separate"),
}
"""What a window tells the next: nothing, or eq. 13 in one of three readings."""


def estimator(
    thickness: float, setting: Setting, *, carryover: Carryover | None = None
) -> CompressiveSensingMHE:
    """Build the paper's estimator for a model of this thickness, output at k = T - N + 1."""
    B = sampled(thickness)[1]
    return CompressiveSensingMHE(
        Noise(sigma_y=math.sqrt(setting.eps_R)),
        Prior(P0=setting.eps_Q * B @ B.T),
        forces=FORCES,
        lam=setting.lam,
        N=N,
        sigma_force=math.sqrt(setting.eps_Q),
        arrival=SmoothedArrival(naive=True),
        carryover=carryover,
        threshold=THRESHOLD,
        bias="kept",
    )
