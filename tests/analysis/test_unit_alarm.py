"""A resonance at another place is no wrong unit, and hides none."""

import numpy as np
import pytest

import backsight as bs

DT, SAMPLES, STIFFNESS = 5e-3, 1500, 1000.0


def recorded(factor: float):
    """An oscillator that is driven at its resonance, its output in other units."""
    t = DT * np.arange(SAMPLES)
    w = np.sqrt(STIFFNESS)
    rest = 0.02 * np.random.default_rng(1).standard_normal(SAMPLES)
    u = np.sin(w * t) + 0.3 * np.sin(1.03 * w * t + 1) + rest
    made = bs.simulate(bs.sdof(k=STIFFNESS, b=1.0, c=1.0), u, dt=DT, sigma_y=1e-5, seed=1)
    return made.assign(y=(made.y.dims, factor * made.y.values))


def found(factor: float, *, spread: float) -> bs.check.Alignment:
    """Judged with a stiffness that is 40 % too small at first."""
    model = bs.augment(bs.sdof(k=0.6 * STIFFNESS, b=1.0, c=1.0), ["k", "b"])
    prior = bs.Prior(sigma_x0={"q": 1e-3, "v": 0.1, "k": spread, "b": 1.0})
    believed = bs.EKF(bs.Noise(sigma_y=1e-5, sigma_w={"v": 1e-4}), prior)
    return bs.check.check_alignment(believed, model, recorded(factor), reach=1)


def test_stiffness_that_is_not_known_yet_raises_no_alarm():
    result = found(1.0, spread=300.0)
    assert result.ratios[0].size == pytest.approx(1.0, abs=0.01)
    assert not any(r.sentence() for r in result.ratios)


@pytest.mark.parametrize("factor", [1e3, 9.81, -1.0])
def test_wrong_units_are_not_explained_away(factor):
    assert found(factor, spread=300.0).ratios[0].sentence()


def test_stiffness_outside_its_prior_explains_nothing():
    assert "times larger" in found(1.0, spread=10.0).ratios[0].sentence()
