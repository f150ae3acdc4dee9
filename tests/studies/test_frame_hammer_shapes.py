"""Shapes of the cantilever of the study `frame_hammer`."""

import dataclasses

import numpy as np
import pytest
import scipy

from backsight.errors import ModelError
from backsight.models.structures._beam_modes import shapes
from backsight_studies.frame_hammer.shapes import Cantilever


class TestShapes:
    BEAM = Cantilever(1.7, bending_stiffness=2100.0, mass_per_length=1.4, tip_mass=1.3)

    def test_without_rotary_inertia_they_are_those_of_the_package(self):
        of = shapes("cantilever", 5, tip=1.3 / (1.7 * 1.4))
        places = [0.3, 0.9, 1.6]
        wanted = of.at(np.array(places) / 1.7).T / np.sqrt(1.7 * 1.4)
        found = self.BEAM.shapes(places, 5)
        signs = np.sign((wanted * found).sum(axis=1))[:, None]
        np.testing.assert_allclose(found, signs * wanted, atol=2e-6)

    def test_with_rotary_inertia_they_are_those_of_finite_elements(self):
        inertia = 0.004
        beam = dataclasses.replace(self.BEAM, tip_inertia=inertia)
        omega, vectors = finite_elements(beam, elements=60)
        np.testing.assert_allclose(beam.frequencies(4), omega[:4] / (2 * np.pi), rtol=1e-5)
        nodes = beam.length * np.array([20, 40]) / 60
        wanted = vectors[[2 * 19, 2 * 39], :4].T
        found = beam.shapes(nodes, 4)
        signs = np.sign((wanted * found).sum(axis=1))[:, None]
        np.testing.assert_allclose(found, signs * wanted, atol=1e-4)

    def test_a_place_off_the_beam_is_refused(self):
        with pytest.raises(ModelError, match="off the beam"):
            self.BEAM.shapes([1.8], 2)


def finite_elements(beam, elements):
    """Frequencies [rad/s] and mass-normalised shapes of Hermite beam elements."""
    a, n = beam.length / elements, 2 * (elements + 1)
    k = beam.bending_stiffness / a**3 * np.array(
        [[12, 6 * a, -12, 6 * a], [6 * a, 4 * a**2, -6 * a, 2 * a**2],
         [-12, -6 * a, 12, -6 * a], [6 * a, 2 * a**2, -6 * a, 4 * a**2]]
    )  # fmt: skip
    m = beam.mass_per_length * a / 420 * np.array(
        [[156, 22 * a, 54, -13 * a], [22 * a, 4 * a**2, 13 * a, -3 * a**2],
         [54, 13 * a, 156, -22 * a], [-13 * a, -3 * a**2, -22 * a, 4 * a**2]]
    )  # fmt: skip
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    for e in range(elements):
        part = slice(2 * e, 2 * e + 4)
        mass[part, part] += m
        stiffness[part, part] += k
    mass[-2, -2] += beam.tip_mass
    mass[-1, -1] += beam.tip_inertia
    values, vectors = scipy.linalg.eigh(stiffness[2:, 2:], mass[2:, 2:])
    return np.sqrt(values), vectors
