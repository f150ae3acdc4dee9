"""Resampling and merging of recordings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.data import from_arrays, merge, read, resample, to_grid
from backsight.data.recording import Group, with_truth
from backsight.errors import DataError


def recording(time, *, u=None, **y):
    names = {"F": "N"} if u is not None else {}
    return from_arrays(
        u=u,
        y=np.stack(list(y.values()), axis=1) if y else np.empty((len(time), 0)),
        time=time,
        inputs=names,
        outputs=dict.fromkeys(y, "m"),
    )


@given(
    n=st.integers(2, 40),
    old=st.floats(1e-4, 10.0),
    new=st.floats(1e-4, 10.0),
    slope=st.floats(-5, 5),
)
def test_a_straight_line_is_resampled_exactly(n, old, new, slope):
    new = max(min(new, old * (n - 1)), old / 50)
    time = 0.7 + old * np.arange(n)
    r = resample(recording(time, u=slope * time, q=1 - time), new)
    np.testing.assert_allclose(r.u[:, 0], slope * r.time, atol=1e-9)
    np.testing.assert_allclose(r.y[:, 0], 1 - r.time, atol=1e-9)
    assert r.attrs["dt"] == new
    assert time[-1] - r.time[-1] < new


def test_missing_samples_stay_missing_and_no_others_get_lost():
    time = np.arange(10) * 0.1
    y = np.where(np.arange(10) % 3 == 0, time, np.nan)
    # Stamps from a file, 0.3, are not the multiples 3 * 0.1 of the period.
    same = resample(recording(np.round(time, 1), q=y), 0.1)
    np.testing.assert_allclose(same.y[:, 0], y)
    # Two of three are missing, and at half the period no other sample lies between neighbours.
    finer = resample(recording(time + 1 / 3, q=y), 0.05)
    np.testing.assert_allclose(finer.y[::2, 0], y)
    assert np.isnan(finer.y[1::2]).all()


def test_resampling_keeps_names_units_and_truth():
    time = np.arange(5) * 0.1
    r = with_truth(recording(time, u=time, q=time), Group(time[:, None] ** 2, {"x": "m"}))
    finer = resample(r, 0.05)
    assert finer.output_unit.values.tolist() == ["m"]
    assert finer.time.attrs == r.time.attrs
    assert finer.x_true.shape == (9, 1)
    assert resample(r, 0.1).x_true.values.tolist() == r.x_true.values.tolist()


def test_outputs_of_a_slower_recording_are_missing_in_between():
    fast, slow = np.arange(9) * 0.01, np.arange(3) * 0.04
    merged = merge(recording(slow, b=slow), recording(fast, u=fast, a=-fast))
    assert merged.output.values.tolist() == ["b", "a"]
    np.testing.assert_array_equal(merged.time, fast)
    np.testing.assert_array_equal(merged.u[:, 0], fast)
    np.testing.assert_array_equal(merged.y[:, 1], -fast)
    expected = np.full(9, np.nan)
    expected[::4] = slow
    np.testing.assert_array_equal(merged.y[:, 0], expected)
    assert merged.attrs["dt"] == pytest.approx(0.01)


def test_inputs_of_a_slower_recording_are_held():
    fast = 0.05 + np.arange(8) * 0.01
    slow = np.array([0.0, 0.04, 0.08, 0.12])
    merged = merge(recording(fast, a=fast), recording(slow, u=np.array([1.0, 2.0, 3.0, 4.0])))
    np.testing.assert_array_equal(merged.u[:, 0], [2, 2, 2, 3, 3, 3, 3, 4])


def test_a_slower_sample_goes_to_the_nearest_time():
    fast, slow = np.arange(20) * 0.01, 0.003 + np.arange(7) * 0.027
    merged = merge(recording(fast, a=fast), recording(slow, u=slow, b=slow))
    measured = ~np.isnan(merged.y[:, 1])
    assert int(measured.sum()) == 7
    assert float(abs(merged.y[:, 1] - merged.time).max()) <= 0.005 + 1e-12
    assert not np.isnan(merged.u).any()


def test_the_result_covers_the_time_that_all_cover():
    fast, slow = np.arange(100) * 0.01, 0.2 + np.arange(5) * 0.1
    merged = merge(recording(fast, a=fast), recording(slow, b=slow))
    np.testing.assert_allclose([merged.time[0], merged.time[-1]], [0.2, 0.6])


def test_truth_is_merged_too():
    fast, slow = np.arange(5) * 0.1, np.arange(3) * 0.2
    known = with_truth(recording(slow, b=slow), Group(slow[:, None], {"x": "m"}))
    merged = merge(recording(fast, a=fast), known)
    np.testing.assert_array_equal(merged.x_true[:, 0], [0, np.nan, 0.2, np.nan, 0.4])


def test_merging_one_recording_changes_nothing():
    time = np.arange(5) * 0.1
    r = recording(time, u=time, a=time)
    assert merge(r).identical(r)


def test_what_cannot_be_merged_is_refused():
    time = np.arange(5) * 0.1
    a = recording(time, a=time)
    with pytest.raises(DataError, match="give at least one"):
        merge()
    with pytest.raises(DataError, match="two recordings have the output 'a'"):
        merge(a, recording(time, a=time))
    with pytest.raises(DataError, match="no time in common: the last begins at 7 s"):
        merge(a, recording(time + 7, b=time))
    for shift in (-0.05, 0.05):
        shifted = time + shift + np.array([1e-4, -1e-4, 0, 0, 2e-4])
        with pytest.raises(DataError, match="fall on the same time"):
            merge(a, recording(shifted, b=time))


@pytest.mark.parametrize("again", [resample, to_grid])
@pytest.mark.parametrize(
    ("dt", "says"), [(1e-12, "claims .* of memory are needed"), (5e-324, "inf samples")]
)
def test_a_period_beyond_all_memory_is_refused_before_anything_is_taken(again, dt, says):
    with pytest.raises(DataError, match=rf"{again.__name__}: .*{says}"):
        again(recording(np.arange(5) * 10.0, q=np.zeros(5)), dt)


@pytest.mark.parametrize("factor", [10**3, 10**6, 10**9])
def test_stamps_that_count_fractions_since_1970_are_no_seconds(tmp_path, factor):
    stamps = 1_700_000_000 * factor + np.arange(5) * factor // 50
    path = tmp_path / "r.csv"
    path.write_text("t,y\n" + "".join(f"{t},1\n" for t in stamps))
    for r in (
        read(path, inputs={}, outputs={"y": "y"}, time="t"),
        from_arrays(y=np.ones(5), inputs={}, outputs={"y": "m"}, time=stamps),
    ):
        assert r.attrs["dt"] == pytest.approx(0.02, rel=1e-12)
        assert r.attrs["begin"] == "2023-11-14T22:13:20"
    told = read(path, inputs={}, outputs={"y": "y"}, time={"name": "t", "factor": 1.0})
    assert told.attrs["dt"] == pytest.approx(0.02 * factor)
