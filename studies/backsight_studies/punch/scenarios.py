"""What is simulated, and which observers run on it."""

import dataclasses

import xarray as xr

from backsight_studies.punch import tuning
from backsight_studies.punch.plant import READINGS, SOFT, STIFF, Reading
from backsight_studies.punch.tuning import Variant, observer, scaled_start

SECONDS = 10.0
"""Length of the recordings with a wrong start [s]."""

FACTORS = (1.8, 1.2)

JUMPS = {"c": (4.0, 1.2), "d": (8.0, 1.3), "m": (12.0, 1.1)}
"""Parameter to the time [s] of its jump and the factor, one after the other."""

JUMPS_END = 16.0

GAIN_JUMP, GAIN_END = 4.0, 6.0
"""Jump of the stiffness by the factor above, for the comparison of fixed and adaptive gain [s]."""

NOISES = (0.0, 0.5e-6, 1e-6, 2e-6)
"""Sensor noise for the bias of the filter [m]."""

SPEED_NOISES = (0.3, 1.0, 3.0)
"""Process noise qx that the filter assumes [m/s2/sqrt(Hz)]."""

AHG, FAST = "AHG", "AHG, g = 30"
DIAGONAL, PRINTED = "AHG, diagonal Γ", "AHG, eq. 10 as printed"
HELD, JOINED = "AHG, y held", "AHG, y joined by lines"
EKF, UKF = "EKF, qx = 0.01", "UKF, qx = 0.01"
EKF1, UKF1, EKF3, UKF3 = "EKF, qx = 1", "UKF, qx = 1", "EKF, qx = 3", "UKF, qx = 3"
FIXED, ADAPTIVE = "fixed gain", "adaptive gain"


@dataclasses.dataclass(frozen=True)
class Scenario:
    """A plant and a wrong start.

    Parameters
    ----------
    reading : Reading
    factor : float
        Start per truth.
    only : str
        The parameter that is wrong; "" for all of them.
    """

    reading: Reading
    factor: float
    only: str = ""

    @property
    def label(self) -> str:
        """For instance "stiff, 1.8 p"."""
        return f"{self.reading.name}, {self.factor} {self.only or 'p'}"

    @property
    def start(self) -> dict[str, float]:
        """Start values of m, c, d."""
        wrong = scaled_start(self.reading, self.factor)
        return {p: wrong[p] if self.only in ("", p) else v for p, v in self.reading.truth.items()}


STARTS = tuple(Scenario(reading, factor) for reading in READINGS for factor in FACTORS)
ONLY_D = tuple(Scenario(reading, 1.8, "d") for reading in READINGS)


def compared(scenario: Scenario, motion: xr.Dataset) -> list[Variant]:
    """The observers that run on every recording of a scenario."""
    reading, start = scenario.reading, scenario.start
    found = [
        observer(AHG, reading, start, motion),
        tuning.ekf(EKF, reading, start, tuning.TUNED),
        tuning.ukf(UKF, reading, start, tuning.TUNED),
    ]
    if reading is STIFF and not scenario.only:
        found += [
            observer(FAST, reading, start, motion, rate=tuning.FAST),
            tuning.ekf(EKF3, reading, start, tuning.PAPER),
            tuning.ukf(UKF3, reading, start, tuning.PAPER),
        ]
    return found


def explored(scenario: Scenario, motion: xr.Dataset) -> list[Variant]:
    """The observers that run on the first recording of a scenario only."""
    reading, start = scenario.reading, scenario.start
    filters = [
        tuning.ekf(EKF1, reading, start, tuning.PLAIN),
        tuning.ukf(UKF1, reading, start, tuning.PLAIN),
    ]
    if scenario.only:
        return filters[:1]
    return [
        observer(DIAGONAL, reading, start, motion, diagonal=True),
        observer(PRINTED, reading, start, motion, form="printed"),
        observer(HELD, reading, start, motion, interpolation="hold"),
        observer(JOINED, reading, start, motion, interpolation="linear"),
        *filters,
    ]


def count(seeds: int) -> int:
    """Number of estimations of the whole study."""
    starts = {SOFT.name: (3, 6), STIFF.name: (6, 6)}
    each = sum(seeds * many + once for many, once in (starts[s.reading.name] for s in STARTS))
    return each + 4 * len(ONLY_D) + 5 * len(READINGS) + 2 * seeds * 2 + 12
