import math

import numpy as np
import pytest

from backsight.analysis.comparison.error_measures import convergence_time, rms_innovation, rmse, rse
from backsight.errors import DataError


def test_rse_is_the_norm_not_the_mean():
    error = np.array([3.0, 0.0, 4.0, 0.0])
    assert float(rse(error, np.zeros(4))) == pytest.approx(5.0)
    assert float(rmse(error, np.zeros(4))) == pytest.approx(2.5)


def test_rse_per_column_equals_the_vector_norm():
    rng = np.random.default_rng(2)
    estimate, truth = rng.standard_normal((2, 50, 3))
    expected = [np.linalg.norm(estimate[:, i] - truth[:, i]) for i in range(3)]
    np.testing.assert_allclose(rse(estimate, truth), expected)
    np.testing.assert_allclose(rmse(estimate, truth), np.array(expected) / math.sqrt(50))


def test_samples_without_target_are_left_out():
    values, target = np.array([1.0, 7.0, 2.0]), np.array([0.0, np.nan, 0.0])
    assert float(rse(values, target)) == pytest.approx(math.sqrt(5.0))
    assert float(rmse(values, target)) == pytest.approx(math.sqrt(2.5))


def test_a_diverged_estimate_never_looks_good():
    assert math.isnan(rse([1.0, np.nan], [1.0, 1.0]))
    assert math.isnan(rmse([1.0, np.nan], [1.0, 1.0]))


def test_no_target_no_error():
    assert math.isnan(rse([1.0], [np.nan]))
    assert math.isnan(rmse([1.0], [np.nan]))


def test_shapes_must_agree():
    with pytest.raises(DataError, match="shape"):
        rse(np.zeros(3), np.zeros((3, 1)))


def test_rms_innovation_uses_measured_samples(gappy):
    seen = np.isfinite(gappy.y.values)
    expected = [np.sqrt(np.mean(gappy.e.values[seen[:, i], i] ** 2)) for i in range(2)]
    np.testing.assert_allclose(rms_innovation(gappy), expected)


def test_convergence_is_the_start_of_the_first_run_inside_the_band():
    values = np.array([2.0, 1.01, 1.0, 1.5, 0.99, 1.0, 1.015, 3.0])
    time = 0.1 * np.arange(8)
    assert convergence_time(values, 1.0, band=0.02, hold=2, time=time) == pytest.approx(0.1)
    assert convergence_time(values, 1.0, band=0.02, hold=3, time=time) == pytest.approx(0.4)
    assert math.isnan(convergence_time(values, 1.0, band=0.02, hold=4, time=time))


def test_convergence_to_a_moving_negative_target():
    target = -np.array([1.0, 2.0, 3.0, 4.0])
    values = target * np.array([1.5, 1.3, 1.001, 0.999])
    assert convergence_time(values, target, band=0.01, hold=2, time=np.arange(4)) == 2.0


def test_nan_is_not_inside_the_band():
    assert convergence_time([np.nan, 1.0], 1.0, band=0.1, hold=1, time=[0.0, 1.0]) == 1.0


def test_hold_longer_than_the_recording_never_happens():
    assert math.isnan(convergence_time([1.0], 1.0, band=0.1, hold=2, time=[0.0]))


def test_the_band_is_open():
    assert math.isnan(convergence_time([1.5], 1.0, band=0.5, hold=1, time=[0.0]))


@pytest.mark.parametrize(("target", "hold", "says"), [(0.0, 1, "zero"), (1.0, 0, "hold")])
def test_senseless_questions_are_refused(target, hold, says):
    with pytest.raises(DataError, match=says):
        convergence_time([1.0], target, band=0.1, hold=hold, time=[0.0])
