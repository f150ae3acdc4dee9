"""What `from_arrays` makes of names and of times that are not plain numbers."""

import datetime

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from backsight.data import from_arrays, merge
from backsight.errors import DataError

N = 10
ANGLE, PRESSURE = np.arange(N) * 1.0, 100 - np.arange(N) * 2.0
FRAME = pd.DataFrame({"pressure": PRESSURE, "note": "x", "angle": ANGLE})
OUTPUTS = {"angle": "rad", "pressure": "bar"}

NAMED = {
    "frame": FRAME,
    "dictionary": {"pressure": PRESSURE, "angle": ANGLE},
    "dataset": xr.Dataset({"pressure": ("k", PRESSURE), "angle": ("k", ANGLE)}),
    "labels": xr.DataArray(
        [PRESSURE, ANGLE], dims=("signal", "k"), coords={"signal": ["pressure", "angle"]}
    ),
    "records": np.array(
        list(zip(PRESSURE, ANGLE, strict=True)), [("pressure", float), ("angle", float)]
    ),
}

START = pd.Timestamp("2026-03-12 10:00:00")
STEPS = np.arange(N) * 200  # microseconds
INDEX = pd.DatetimeIndex([START + pd.Timedelta(k, "us") for k in STEPS.tolist()])
TIMES = {
    "index": INDEX,
    "of Berlin": INDEX.tz_localize("Europe/Berlin"),
    "series": pd.Series(INDEX),
    "nanoseconds": INDEX.to_numpy().astype("datetime64[ns]"),
    "microseconds": INDEX.to_numpy().astype("datetime64[us]"),
    "intervals": pd.to_timedelta(STEPS, unit="us"),
    "timedelta64": STEPS.astype("timedelta64[us]"),
    "of Python": [stamp.to_pydatetime() for stamp in INDEX],
    "intervals of Python": [datetime.timedelta(microseconds=k) for k in STEPS.tolist()],
    "text": [stamp.isoformat(timespec="microseconds") for stamp in INDEX],
    "text with zone": [stamp.isoformat(timespec="microseconds") + "+01:00" for stamp in INDEX],
    "German": list(INDEX.strftime("%d.%m.%Y %H:%M:%S.%f")),
}


@pytest.mark.parametrize("kind", NAMED)
def test_what_has_names_goes_in_by_name(kind):
    r = from_arrays(y=NAMED[kind], dt=0.1, inputs={}, outputs=OUTPUTS)
    np.testing.assert_array_equal(r.y, np.c_[ANGLE, PRESSURE])


@pytest.mark.parametrize("kind", NAMED)
def test_names_that_do_not_fit_are_refused(kind):
    with pytest.raises(DataError, match=r"y has no column 'angel': did you mean 'angle'.*by name"):
        from_arrays(y=NAMED[kind], dt=0.1, inputs={}, outputs={"angel": "rad", "pressure": "bar"})


def test_one_frame_for_all():
    frame = FRAME.assign(t=np.arange(N) * 0.5)
    r = from_arrays(u=frame, y=frame, time="t", inputs={"pressure": ""}, outputs={"angle": ""})
    np.testing.assert_array_equal(r.u[:, 0], PRESSURE)
    assert r.attrs["dt"] == 0.5


def test_a_frame_without_names_is_refused():
    with pytest.raises(DataError, match="y has no column 'angle'"):
        from_arrays(y=pd.DataFrame(np.c_[ANGLE, PRESSURE]), dt=1.0, inputs={}, outputs=OUTPUTS)


@pytest.mark.parametrize("kind", TIMES)
def test_times_are_right_to_the_nanosecond(kind):
    r = from_arrays(y=ANGLE, time=TIMES[kind], inputs={}, outputs={"angle": "rad"})
    np.testing.assert_allclose(r.time, STEPS * 1e-6, rtol=0, atol=1e-12)
    assert r.attrs["dt"] == pytest.approx(2e-4, rel=1e-12)
    dated = "interval" not in kind and "delta" not in kind
    hour = "09" if "Berlin" in kind or "zone" in kind else "10"
    assert r.attrs.get("begin", "") == (f"2026-03-12T{hour}:00:00" if dated else "")


def test_the_index_of_a_frame_is_its_time():
    r = from_arrays(y=FRAME.set_index(INDEX), inputs={}, outputs=OUTPUTS)
    assert r.attrs["dt"] == pytest.approx(2e-4, rel=1e-12)
    with pytest.raises(DataError, match=r"dt is 0\.1 s, but by their time"):
        from_arrays(y=FRAME.set_index(INDEX), dt=0.1, inputs={}, outputs=OUTPUTS)
    later = FRAME.set_index(INDEX + pd.Timedelta("1ms"))
    with pytest.raises(DataError, match="u and y have indices of different times"):
        from_arrays(
            u=later, y=FRAME.set_index(INDEX), inputs={"pressure": "bar"}, outputs={"angle": "rad"}
        )


def test_numbers_from_dates_are_refused_as_signals():
    with pytest.raises(DataError, match="y is not an array of real numbers, but of dates"):
        from_arrays(y=INDEX.to_numpy(), dt=1.0, inputs={}, outputs={"angle": "rad"})


def test_recordings_with_dates_are_merged_by_date():
    first = from_arrays(y=ANGLE, time=INDEX, inputs={}, outputs={"a": ""})
    shifted = INDEX + pd.Timedelta("400us")
    second = from_arrays(y=ANGLE, time=shifted, inputs={}, outputs={"b": ""})
    merged = merge(second, first)
    assert merged.attrs["begin"] == "2026-03-12T10:00:00"
    np.testing.assert_allclose(merged.time, STEPS[2:] * 1e-6, atol=1e-12)
    np.testing.assert_array_equal(merged.y, np.c_[ANGLE[:-2], ANGLE[2:]])
    plain = from_arrays(y=ANGLE, dt=2e-4, inputs={}, outputs={"c": ""})
    with pytest.raises(DataError, match="some recordings have dates"):
        merge(first, plain)


@pytest.mark.parametrize("dt", [1.024, 0.9766, 4.88])
@pytest.mark.parametrize("cut", [np.round, np.floor])
def test_rounded_stamps_are_the_grid_behind_them(dt, cut):
    stamps = cut(dt * np.arange(300)) * 1e-3
    stamps = stamps if dt > 1 else cut(dt * np.arange(300) * 10) * 1e-4
    r = from_arrays(y=stamps, time=stamps, inputs={}, outputs={"y": ""})
    assert r.attrs["dt"] == pytest.approx(dt * 1e-3, rel=2e-4)
    assert np.ptp(np.diff(r.time)) < 1e-12
    assert "rounded to" in r.attrs["understood"]


def test_a_lost_sample_is_no_rounding():
    stamps = np.round(np.delete(np.arange(100), 40) * 1.0, 3)
    with pytest.raises(DataError, match=r"irregular.*on average they are 1.01"):
        from_arrays(y=stamps, time=stamps, inputs={}, outputs={"y": ""})
    stamps = np.delete(np.arange(400), [50, 130, 131, 300]) * 0.005
    with pytest.raises(DataError, match="irregular"):
        from_arrays(y=stamps, time=stamps, inputs={}, outputs={"y": ""})
