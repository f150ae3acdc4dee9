import math

import numpy as np
import pytest

from backsight.analysis.consistency._coverage import (
    NORMAL,
    coverage,
    innovation_coverage,
    mean_nees,
    nees,
)


@pytest.fixture(scope="module")
def result(believing_results):
    return believing_results(8)[0]


def test_nees_is_the_plain_formula(result):
    expected = [
        (x - m) @ np.linalg.solve(P, x - m)
        for x, m, P in zip(result.x_true.values, result.x_hat.values, result.P.values, strict=True)
    ]
    np.testing.assert_allclose(nees(result), expected, rtol=1e-6)


def test_unknown_truth_takes_its_state_out(result):
    half = result.assign(x_true=result.x_true.where(result.state == "q"))
    error = (result.x_true - result.x_hat).values[:, 0]
    np.testing.assert_allclose(nees(half), error**2 / result.P.values[:, 0, 0], rtol=1e-9)
    assert mean_nees(half).expected == 1.0


def test_direction_without_variance_is_left_out(result):
    P = result.P.values.copy()
    P[:, 1] = P[:, :, 1] = 0.0
    exact = result.assign(P=(result.P.dims, P), x_std=result.x_std * [1.0, 0.0])
    assert np.isfinite(nees(exact)).all()
    assert mean_nees(exact).expected == 1.0


def test_mean_nees_lies_in_its_band_and_counts_few_samples(believing_results):
    found = [mean_nees(r) for r in believing_results(8)]
    assert sum(f.band[0] < f.value < f.band[1] for f in found) >= 7
    assert all(20 < f.independent < 1500 for f in found)


def test_nees_of_a_filter_that_believes_in_too_little_noise(believing_results):
    for found in map(mean_nees, believing_results(4, n=1500, Q_true=16.0)):
        assert found.value > found.band[1]


def test_bands_hold_the_truth_as_often_as_they_say(believing_results):
    shares = np.mean([coverage(r).values for r in believing_results(8)], axis=0)
    np.testing.assert_allclose(shares, np.array(NORMAL)[:, None] * np.ones(2), atol=0.04)
    shares = np.mean([innovation_coverage(r).values for r in believing_results(8)], axis=0)
    np.testing.assert_allclose(shares[:, 0], NORMAL, atol=0.01)


def test_without_truth_there_is_nothing_to_say(result):
    blind = result.drop_vars("x_true")
    assert np.isnan(nees(blind)).all()
    assert math.isnan(mean_nees(blind).value)
    assert np.isnan(coverage(blind)).all()
