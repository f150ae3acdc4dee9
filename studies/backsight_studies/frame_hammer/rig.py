"""The rig: a steel tube clamped upright with a mass on top, four accelerometers, a hammer.

Length, section, mass, places of sensors and hits are those of the data set. The rest was identified
from free vibrations in its two recordings: natural frequencies, damping, the rotary inertia of the
tip mass, the low-pass of the sensors, and two of their properties that the data set does not
mention. Their range is limited *before* their low-pass, so that a hard hit is seen through a
clipped signal; and their channels are read one after the other, not at the same time.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from backsight.types import Array
from backsight_studies.frame_hammer.shapes import Cantilever

DT = 1.0997e-3
"""Sampling period of the accelerometers [s]."""

SUBSTEPS = 8
"""Steps per sample in which clipping and low-pass are computed; one is also the time that passes
from reading one channel to reading the next."""

STEP = DT / SUBSTEPS
"""Of the clipping and the low-pass [s]."""

LSB = 0.0981
"""Of the 10-bit readings [m/s2]."""

LENGTH, TIP_MASS, MASS_PER_LENGTH, YOUNGS_MODULUS = 1.715, 1.31, 7850.0 * 1.74e-4, 2.1e11

SENSORS = (0.34, 0.68, 1.02, 1.36)
"""Heights of the accelerometers [m]."""

HEIGHTS = (0.81, 1.24, 1.60)
"""Heights at which the beam may be hit [m]."""

TWIST = (0.21, 0.41, 0.69, 1.0)
"""What the accelerometers see of a further mode near 141 Hz that is in both directions: twisting,
presumably. A hit beside the axis of the tube excites it, by how much is not known."""

WIDTHS = (1.0e-3, 1.5e-3, 2.2e-3, 3.0e-3)
"""Durations of the half-sine pulses that a hit may have [s]."""


@dataclasses.dataclass(frozen=True)
class Axis:
    """The rig in one direction of bending.

    Parameters
    ----------
    name : str
    second_moment : float
        Of the section [m4].
    tip_inertia : float
        Rotary inertia of the tip mass [kg m2].
    frequencies, damping : tuple
        Natural frequencies [Hz] and damping ratios of the bending modes and, last, of the twist.
    limit : float
        The sensors see no acceleration beyond this [m/s2].
    cutoff : float
        Of their low-pass of the first order, behind the limit [Hz].
    """

    name: str
    second_moment: float
    tip_inertia: float
    frequencies: tuple[float, ...]
    damping: tuple[float, ...]
    limit: float
    cutoff: float

    def only(self, modes: NDArray[np.bool_]) -> "Axis":
        """The same with the modes (modes,) that are true; the twist must be one of them."""
        return dataclasses.replace(
            self,
            frequencies=tuple(np.array(self.frequencies)[modes]),
            damping=tuple(np.array(self.damping)[modes]),
        )

    @property
    def modes(self) -> int:
        """Number of modes."""
        return len(self.frequencies)

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues with a positive imaginary part [1/s], (modes,)."""
        omega, ratio = 2 * np.pi * np.array(self.frequencies), np.array(self.damping)
        return omega * (-ratio + 1j * np.sqrt(1 - ratio**2))

    @cached_property
    def seen(self) -> Array:
        """What every accelerometer sees of every mode, (modes, sensors)."""
        return np.vstack([self.at(SENSORS), TWIST])

    @cached_property
    def driven(self) -> Array:
        """How much of every mode a hit drives, (heights, modes): not the twist."""
        return np.vstack([self.at(HEIGHTS), np.zeros(len(HEIGHTS))]).T

    @property
    def memory(self) -> float:
        """What is left of a low-pass after one step."""
        return float(np.exp(-2 * np.pi * self.cutoff * STEP))

    def at(self, places: Sequence[float]) -> Array:
        """Mass-normalised shapes of the bending modes, (modes - 1, places)."""
        beam = Cantilever(
            LENGTH,
            bending_stiffness=YOUNGS_MODULUS * self.second_moment,
            mass_per_length=MASS_PER_LENGTH,
            tip_mass=TIP_MASS,
            tip_inertia=self.tip_inertia,
        )
        return beam.shapes(places, self.modes - 1)


WEAK = Axis(
    "weak axis",
    second_moment=1.02e-8,
    tip_inertia=0.0004,
    frequencies=(4.15, 35.2, 107.31, 218.4, 367.11, 553.04, 764.4, 1005.0, 141.05),
    damping=(0.006, 0.004, 0.0004, 0.0019, 0.0011, 0.0015, 0.0016, 0.0027, 0.0003),
    limit=47.75,
    cutoff=49.3,
)

STRONG = Axis(
    "strong axis",
    second_moment=1.94e-8,
    tip_inertia=0.001,
    frequencies=(5.81, 50.0, 148.8, 300.04, 501.43, 746.1, 1023.0, 1332.0, 141.3),
    damping=(0.006, 0.008, 0.0009, 0.0013, 0.0006, 0.0014, 0.0027, 0.0027, 0.0015),
    limit=52.1,
    cutoff=45.9,
)

AXES = (WEAK, STRONG)
