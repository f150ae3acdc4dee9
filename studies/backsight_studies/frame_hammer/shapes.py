r"""Mode shapes of a cantilever whose tip carries a mass with rotary inertia.

The tip takes the shear force and the bending moment that move the mass,

.. math:: EI\,w''' = -m\,\omega^2 w, \qquad EI\,w'' = J\,\omega^2 w'.

Source: Blevins, "Formulas for Natural Frequency and Mode Shape", 1979, chapter 8.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy

from backsight.errors import ModelError
from backsight.types import Array

GRID = 40
"""Intervals per half wave in which a root is looked for."""


@dataclasses.dataclass(frozen=True)
class Cantilever:
    """Uniform Euler-Bernoulli beam, clamped at 0.

    Parameters
    ----------
    length : float
        [m].
    bending_stiffness, mass_per_length : float
        E I [N m2], rho A [kg/m].
    tip_mass, tip_inertia : float
        At the free end [kg, kg m2].
    """

    length: float
    bending_stiffness: float
    mass_per_length: float
    tip_mass: float = 0.0
    tip_inertia: float = 0.0

    def frequencies(self, modes: int) -> Array:
        """Natural frequencies [Hz], (modes,)."""
        speed = np.sqrt(self.bending_stiffness / self.mass_per_length)
        return (self._roots(modes) / self.length) ** 2 * speed / (2 * np.pi)

    def shapes(self, places: Sequence[float], modes: int) -> Array:
        """Mass-normalised shapes, (modes, places) [1/sqrt(kg)]; positive at the tip."""
        xi = np.asarray(places, float) / self.length
        if (xi < 0).any() or (xi > 1).any():
            raise ModelError(f"a place is off the beam, which goes from 0 to {self.length:g} m")
        return np.stack([self._shape(z, xi) for z in self._roots(modes)])

    def _conditions(self, z: float) -> Array:
        """Moment and shear at the tip for the two shapes that a clamped end allows, (2, 2)."""
        beam = self.mass_per_length * self.length
        mass, inertia = self.tip_mass / beam, self.tip_inertia / (beam * self.length**2)
        w, slope, moment, shear = (_clamped(z, np.array(1.0), k) for k in range(4))
        return np.array([moment - inertia * z**3 * slope, shear + mass * z * w])

    def _roots(self, modes: int) -> Array:
        def determinant(z: float) -> float:
            return float(np.linalg.det(self._conditions(z)) / np.cosh(z) ** 2)

        grid = np.linspace(0.05, np.pi * (modes + 1), GRID * (modes + 1))
        values = np.array([determinant(z) for z in grid])
        turns = np.flatnonzero(values[:-1] * values[1:] < 0)[:modes]
        return np.array(
            [scipy.optimize.brentq(determinant, grid[i], grid[i + 1], xtol=1e-13) for i in turns]
        )

    def _shape(self, z: float, xi: Array) -> Array:
        conditions = self._conditions(z)
        mix = np.array([conditions[0, 1], -conditions[0, 0]])
        mix = mix / np.abs(mix).max()
        fine = np.linspace(0.0, 1.0, 2001)
        w, tip, slope = (
            np.tensordot(mix, _clamped(z, x, k), 1)
            for x, k in ((fine, 0), (np.array(1.0), 0), (np.array(1.0), 1))
        )
        mass = self.mass_per_length * self.length * np.trapezoid(w**2, fine)
        mass += self.tip_mass * tip**2 + self.tip_inertia * (slope * z / self.length) ** 2
        return np.sign(tip) * np.tensordot(mix, _clamped(z, xi, 0), 1) / np.sqrt(mass)


def _clamped(z: float, xi: Array, derivative: int) -> Array:
    """Derivatives by z xi of cosh - cos and sinh - sin, stacked."""
    even, odd = (np.cosh, np.sinh) if derivative % 2 == 0 else (np.sinh, np.cosh)
    turn = derivative * np.pi / 2
    return np.stack([even(z * xi) - np.cos(z * xi + turn), odd(z * xi) - np.sin(z * xi + turn)])
