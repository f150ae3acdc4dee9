import math

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from backsight.analysis.consistency import (
    log_likelihood,
    mean_nis,
    measured_channels,
    nis,
    nis_band,
    windowed_nis,
)
from backsight.errors import DataError


def nis_by_deleting_rows(result):
    values = []
    for y, e, S in zip(result.y.values, result.e.values, result.S.values, strict=True):
        seen = [i for i in range(len(y)) if not math.isnan(y[i])]
        inverse = np.linalg.inv(S[np.ix_(seen, seen)]) if seen else None
        values.append(e[seen] @ inverse @ e[seen] if seen else math.nan)
    return np.array(values)


def test_nis_equals_the_plain_loop(result, gappy):
    for case in (result, gappy):
        np.testing.assert_allclose(nis(case), nis_by_deleting_rows(case), rtol=1e-9)


def test_log_likelihood_equals_scipy(result, gappy):
    for case in (result, gappy):
        expected = []
        for y, e, S in zip(case.y.values, case.e.values, case.S.values, strict=True):
            seen = np.flatnonzero(~np.isnan(y))
            part = S[np.ix_(seen, seen)]
            expected.append(multivariate_normal(cov=part).logpdf(e[seen]) if seen.size else np.nan)
        np.testing.assert_allclose(log_likelihood(case), expected, rtol=1e-9)


def test_a_sample_without_measurement_has_no_nis(gappy):
    unmeasured = measured_channels(gappy).values == 0
    assert unmeasured.any()
    np.testing.assert_array_equal(np.isnan(nis(gappy)), unmeasured)


def test_unmeasured_channels_do_not_matter_whatever_stands_there(gappy):
    lost = np.isnan(gappy.y)
    spoilt = gappy.assign(
        e=gappy.e.where(~lost, 1e6),
        S=gappy.S.where(~lost.values[:, :, None] & ~lost.values[:, None, :], np.nan),
    )
    np.testing.assert_array_equal(nis(spoilt), nis(gappy))
    np.testing.assert_array_equal(log_likelihood(spoilt), log_likelihood(gappy))


def test_outputs_of_very_different_size_are_no_obstacle(result):
    size = np.array([1e-12, 1e9])
    scaled = result.assign(e=result.e * size, S=result.S * size[:, None] * size, y=result.y * size)
    np.testing.assert_allclose(nis(scaled), nis(result), rtol=1e-9)
    shift = np.log(size).sum()
    np.testing.assert_allclose(log_likelihood(scaled), log_likelihood(result) - shift, rtol=1e-9)


@pytest.mark.parametrize(
    "S", [[[1.0, 2.0], [2.0, 1.0]], [[0.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1.0]]]
)
def test_a_covariance_that_is_none_gives_nan_there_and_only_there(result, S):
    covariance = result.S.values.copy()
    covariance[7] = S
    spoilt = result.assign(S=(result.S.dims, covariance))
    assert np.flatnonzero(np.isnan(nis(spoilt))).tolist() == [7]
    assert np.flatnonzero(np.isnan(log_likelihood(spoilt))).tolist() == [7]


def test_infinite_innovation_gives_nan(result):
    e = result.e.values.copy()
    e[3, 0] = np.inf
    assert math.isnan(nis(result.assign(e=(result.e.dims, e)))[3])


def test_mean_nis_of_the_optimal_filter_lies_in_its_band(result, gappy):
    for case in (result, gappy):
        low, high = nis_band(case, 0.99)
        assert low < mean_nis(case) < high


def test_a_filter_that_believes_in_too_little_noise_is_found(filtered):
    bold = filtered(noise_factor=0.25)
    assert mean_nis(bold) > 2 * nis_band(bold)[1]
    assert mean_nis(filtered(noise_factor=4.0)) < nis_band(bold)[0] / 2


def test_band_counts_the_measured_channels(gappy):
    channels = np.isfinite(gappy.y.values).sum()
    samples = np.isfinite(gappy.y.values).any(axis=1).sum()
    assert nis_band(gappy, 0.9) == pytest.approx(chi2.ppf([0.05, 0.95], channels) / samples)


def test_band_covers_as_often_as_it_says(gappy):
    rng = np.random.default_rng(5)
    part = gappy.isel(time=slice(0, 40))
    low, high = nis_band(part)
    roots = np.linalg.cholesky(part.S.values)
    hits = 0
    for _ in range(500):
        e = np.einsum("kij,kj->ki", roots, rng.standard_normal((40, 2)))
        hits += low < mean_nis(part.assign(e=(part.e.dims, e))) < high
    assert hits / 500 == pytest.approx(0.95, abs=0.03)


def test_nothing_measured_has_no_band(result):
    blind = result.assign(y=result.y * np.nan)
    assert all(math.isnan(limit) for limit in nis_band(blind))
    assert math.isnan(mean_nis(blind))


def test_windows_are_means_of_their_samples(gappy):
    windows = windowed_nis(gappy, 7)
    values = nis(gappy).values
    assert len(windows.time) == 43
    np.testing.assert_allclose(windows.nis[:3], [np.nanmean(values[i : i + 7]) for i in (0, 7, 14)])
    np.testing.assert_allclose(windows.nis[-1], np.nanmean(values[42 * 7 :]))
    assert windows.time[0] == pytest.approx(gappy.time[3])
    first = gappy.isel(time=slice(0, 7))
    assert (windows.lower[0], windows.upper[0]) == pytest.approx(nis_band(first))


def test_windows_of_an_outage_are_nan(result):
    y = result.y.values.copy()
    y[20:40] = np.nan
    windows = windowed_nis(result.assign(y=(result.y.dims, y)), 10)
    assert np.isnan(windows.nis[2:4]).all()
    assert np.isnan(windows.lower[2:4]).all()
    assert np.isfinite(windows.nis[[0, 1, 4, 5]]).all()


def test_one_window_of_all_samples_is_the_mean(gappy):
    windows = windowed_nis(gappy, len(gappy.time))
    assert float(windows.nis[0]) == pytest.approx(mean_nis(gappy))


def test_empty_window_is_refused(result):
    with pytest.raises(DataError, match="0 samples"):
        windowed_nis(result, 0)
