"""Place and moment of hits of the study `beam_random`, beside what a recording can tell."""

import numpy as np
import pytest

import backsight as bs
from backsight_studies.beam import plant
from backsight_studies.beam_random import located


def test_readings_are_those_of_the_beam():
    """Duhamel's integral against exact steps: a first state, and what swings from it."""
    first = np.array([1e-4, -2e-4, 1e-4, 1e-3, 2e-3, -1e-3])
    names = [f"q{i}{e}" for e in ("", "_dot") for i in (1, 2, 3)]
    model = plant.model(plant.THICKNESS[0.0])
    steps = bs.simulate(
        model, np.zeros((plant.SAMPLES, 0)), dt=plant.DT, sigma_y=1e-12, seed=1,
        x0=dict(zip(names, first, strict=True)),
    )  # fmt: skip
    found = located.outputs([], first)
    np.testing.assert_allclose(found, steps["y"], rtol=0, atol=1e-7 * np.abs(found).max())


@pytest.mark.slow
def test_bands_are_the_cramer_rao_bound():
    """Deviations of the fit, by the filter, and the bound, by the integral, of the same hits."""
    found = located.located(range(2), 0.002)
    assert (found.hits, found.found) == (8, 8)
    for columns in (found.place, found.time):
        error, std, least = np.abs(columns).T
        assert np.median(std / least) == pytest.approx(1.0, abs=0.1)
        assert (error < 4 * np.maximum(std, least)).all()
    assert "within a tenth" in str(found)
