import base64

import numpy as np
import pytest

from backsight.report._traces import band_trace, drawn, encoded, line_trace, moments
from backsight.report.ranges import bulk, view
from backsight.report.thin import envelope, interval_length, thin


def test_short_recordings_are_kept_whole():
    assert thin(np.arange(2000.0)).tolist() == list(range(2000))
    assert interval_length(2000) == 1


@pytest.mark.parametrize("n", [2001, 2999, 24841, 100_003])
def test_every_interval_keeps_its_extremes(n):
    values = np.random.default_rng(3).standard_normal(n)
    kept, length = thin(values), interval_length(n)
    assert len(kept) <= 2002
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0
    assert kept[-1] == n - 1
    for start in range(0, n, length):
        inside = kept[(kept >= start) & (kept < start + length)]
        part = values[start : start + length]
        assert values[inside].min() == part.min()
        assert values[inside].max() == part.max()


def test_a_single_peak_survives():
    values = np.zeros(50_000)
    values[31_337] = 1.0
    assert 31_337 in thin(values)


def test_gaps_survive_and_do_not_hide_values():
    values = np.random.default_rng(4).standard_normal(20_000)
    values[5_000:9_000] = np.nan
    values[12_345:12_348] = np.inf
    drawn = values[thin(values)]
    assert np.isnan(drawn).any()
    assert np.nanmax(drawn[np.isfinite(drawn)]) == values[np.isfinite(values)].max()


def test_nothing_but_gaps():
    assert np.isnan(np.full(9000, np.nan)[thin(np.full(9000, np.nan))]).all()


def test_envelope_contains_the_band_everywhere():
    n = 12_345
    rng = np.random.default_rng(6)
    lower, upper = -rng.random(n), rng.random(n)
    kept, low, high = envelope(lower, upper)
    place = np.searchsorted(kept, np.arange(n), side="right") - 1
    assert (low[place] <= lower).all()
    assert (high[place] >= upper).all()


def numbers(encoded):
    """As the page's script reads them."""
    if "places" in encoded:
        at = numbers(encoded["places"])
        gap = np.iinfo(encoded["places"]["dtype"]).max
        return np.where(at == gap, np.nan, encoded["start"] + encoded["step"] * at)
    return np.frombuffer(base64.b64decode(encoded["bdata"]), f"<{encoded['dtype']}")


def test_band_is_interrupted_where_it_is_not_finite():
    time, std = np.arange(6.0), np.array([1.0, 1.0, np.nan, 1.0, 1.0, np.inf])
    trace = band_trace(time, -std, std, colour="--ink")
    x, y = numbers(trace["x"]), numbers(trace["y"])
    np.testing.assert_array_equal(x, [0, 1, 1, 0, np.nan, 3, 4, 4, 3, np.nan])
    np.testing.assert_array_equal(y, [1, 1, -1, -1, np.nan, 1, 1, -1, -1, np.nan])


def test_band_without_any_limits_is_empty():
    nothing = np.full(5, np.nan)
    assert np.isnan(
        numbers(band_trace(np.arange(5.0), nothing, nothing, colour="--ink")["y"])
    ).all()


def test_slow_sensors_and_lost_samples_are_joined_and_outages_are_not():
    y = np.full(60, np.nan)
    y[::3] = 1.0
    assert drawn(y).tolist() == list(range(0, 60, 3))
    y[12] = np.nan
    assert drawn(y).tolist() == [i for i in range(0, 60, 3) if i != 12]
    y[18:40] = np.nan
    kept = drawn(y)
    assert np.isnan(y[kept]).sum() == 1
    assert kept[np.isnan(y[kept])].tolist() == [16]


def test_outages_stay_visible_in_long_recordings():
    y = np.sin(np.arange(24_841))
    y[12_003:12_020] = np.nan
    kept = drawn(y)
    assert np.isnan(y[kept]).sum() == 1
    assert len(kept) < 2100


def test_joining_nothing_and_one():
    assert drawn(np.full(3, np.nan)).tolist() == [0, 1, 2]
    assert drawn(np.array([np.nan, 1.0])).tolist() == [0, 1]


def test_few_samples_get_dots():
    few, many = (line_trace(np.arange(n), np.ones(n), name="y", colour="--ink") for n in (1, 500))
    assert few["mode"] == "lines+markers"
    assert many["mode"] == "lines"


def test_view_ignores_a_wide_start_but_no_peak():
    t = np.linspace(0.0, 1.0, 1000)
    x, std = np.sin(20 * t), np.where(t < 0.03, 1e6, 0.01)
    x[500] = 3.0
    low, high = view([x], [x - 3 * std, x + 3 * std])
    assert -2 < low < -1
    assert 3 < high < 4


def test_view_keeps_rare_peaks_and_drops_a_far_start():
    x = np.zeros(10_000)
    x[7_000] = 225.0
    assert view([x], [])[1] > 225
    start = np.where(np.arange(1000) < 5, 1e3, np.sin(np.arange(1000)))
    assert view([start], [])[1] < 2


def test_bulk_leaves_out_rare_values():
    e = np.append(np.linspace(-1.0, 1.0, 999), 400.0)
    assert bulk(e) == pytest.approx([-1.0, 1.0], abs=0.02)
    assert bulk(np.array([np.nan])).size == 0


def test_view_of_constants_and_of_nothing():
    assert view([np.zeros(5)], []) == [-1.0, 1.0]
    assert view([np.full(5, np.nan)], [np.array([])]) is None


def test_times_of_samples_are_exact_or_as_they_are():
    time, kept = 3.0 + 1e-3 * np.arange(70_000), np.array([0, 5, 69_999])
    told = moments(time, kept)
    assert told["places"]["dtype"] == "u4"
    np.testing.assert_allclose(numbers(told), time[kept], rtol=1e-14)
    uneven = np.array([0.0, 1.0, 5.0])
    np.testing.assert_array_equal(numbers(moments(uneven, np.array([0, -1, 2]))), [0, np.nan, 5])


def test_single_precision_only_where_nobody_sees_it():
    assert encoded(np.array([0.0, 1.0]))["dtype"] == "f4"
    small = encoded(1e6 + 1e-3 * np.arange(5.0))
    assert small["dtype"] == "f8"
    np.testing.assert_array_equal(numbers(small), 1e6 + 1e-3 * np.arange(5.0))
    assert encoded(np.array([1e300, -1e300]))["dtype"] == "f8"
