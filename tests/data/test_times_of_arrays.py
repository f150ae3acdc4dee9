"""Times in any kind of array and of writing are the same seconds, or one line says why not."""

import datetime

import numpy as np
import pandas as pd
import pytest

from backsight.data import _room
from backsight.data.texts._numbers import NumberForm, is_numeric, signs
from backsight.data.times import clock
from backsight.errors import DataError


def seconds(values, time_format=None):
    return clock.seconds(values, time_format=time_format, where="it")


DAY = datetime.date(2024, 3, 1)
MOMENTS = [datetime.datetime(2024, 3, 1, 12, 0, s) for s in (0, 1, 3)]
TEXTS = {
    "%Y-%m-%d %H:%M:%S": None, "%Y%m%dT%H%M%S": None, "%d.%m.%Y %H:%M:%S": None,
    "%b %d, %Y %H:%M:%S": None, "%m/%d/%Y %I:%M:%S %p": "%m/%d/%Y %I:%M:%S %p",
    "%d-%b-%y %H:%M:%S": None, "%H-%M-%S": "%H-%M-%S", "%H:%M:%S": None,
}  # fmt: skip


@pytest.mark.parametrize("unit", ["D", "h", "m", "s", "ms", "us", "ns", "ps"])
def test_intervals_of_any_unit(unit):
    lasting = {"D": 86400.0, "h": 3600.0, "m": 60.0}.get(unit, 1.0)
    count = {"ms": 10**3, "us": 10**6, "ns": 10**9, "ps": 10**12}.get(unit, 1)
    intervals = np.array([0, count, 3 * count], f"timedelta64[{unit}]")
    np.testing.assert_array_equal(seconds(intervals)[0], [0, lasting, 3 * lasting])
    stamps = np.datetime64("2024-03-01T00:00:00", unit) + intervals
    np.testing.assert_array_equal(seconds(stamps)[0], [0, lasting, 3 * lasting])
    stamps[1] = np.datetime64("NaT")
    np.testing.assert_array_equal(seconds(stamps)[0], [0, np.nan, 3 * lasting])


@pytest.mark.parametrize(("written", "time_format"), TEXTS.items())
def test_moments_however_they_are_written(written, time_format):
    begin = 0 if "d" in written else 12 * 3600  # a clock counts from midnight
    texts = [m.strftime(written) for m in MOMENTS]
    for cells in (texts, [t.encode() for t in texts], np.array(texts)):
        np.testing.assert_array_equal(seconds(cells, time_format)[0] - begin, [0, 1, 3])
    gap = seconds([texts[0], "", texts[2]], time_format)[0]
    np.testing.assert_array_equal(gap - begin, [0, np.nan, 3])


def test_objects_that_are_times():
    intervals = [m - MOMENTS[0] for m in MOMENTS]
    daily = [m.time() for m in MOMENTS]
    zone = pd.Series(pd.DatetimeIndex(MOMENTS).tz_localize("Asia/Tokyo"))
    for values in (MOMENTS, intervals, daily, zone):
        given = values if isinstance(values, pd.Series) else np.array(values, object)
        found = seconds(given)[0]
        np.testing.assert_array_equal(found - found[0], [0, 1, 3])
    days = np.array([DAY, DAY + datetime.timedelta(days=2)], object)
    np.testing.assert_array_equal(seconds(days)[0], [0, 2 * 86400])
    assert np.isnan(seconds(np.array(["NaT", "NaT"], "M8[ns]"))[0]).all()
    assert np.isnan(seconds(["", "nan"])[0]).all()


@pytest.mark.parametrize(
    ("values", "time_format", "said"),
    [
        (np.array([1j, 2j]), None, "give numbers"),
        (np.array([1.0, 2.0]), "%H:%M", "time holds numbers"),
        (["20240301T120000", "soon"], None, "among dates of digits"),
        (["12:00:01.5", "soon"], None, "among clock times"),
        (["12:00", "12:01"], None, "hours or minutes first"),
        (["Mar 1, 2024", "soon"], None, "not written as"),
        (["03/04/2024 12:00", "04/04/2024 12:00"], None, "the day or the month"),
        (["soon", "later"], None, "no date that is known"),
        (np.array([object(), object()]), None, "not an array of numbers or dates"),
    ],
)
def test_what_is_no_time_is_said(values, time_format, said):
    with pytest.raises(DataError, match=said):
        seconds(values, time_format)


@pytest.mark.parametrize(
    ("cell", "decimal", "thousands", "value"),
    [
        ("inf", ".", None, np.inf), ("1,234.5", ".", ",", 1234.5), ("12,34.5", ".", ",", None),
        ("1.5", ",", None, None), ("1.234,5", ",", ".", 1234.5), ("1_0", ".", None, None),
        ("1.5D+03", ".", None, 1500.0), ("1.5-300", ".", None, 1.5e-300),
    ],
)  # fmt: skip
def test_numbers_by_their_signs(cell, decimal, thousands, value):
    found = NumberForm(decimal, thousands).value(cell)
    assert found is None if value is None else found == value


def test_signs_follow_from_all_cells():
    assert signs(["1,234.5"]) == (".", ",")
    assert signs(["1.234.567", "2,5"]) == (",", ".")
    assert signs(["1.234"])[0] == "."
    assert is_numeric("1'234'567")
    with pytest.raises(DataError, match="may be"):
        signs(["1,234"])


def test_what_is_claimed_must_fit_into_memory_and_file():
    _room.check_room(10**6, "it")
    _room.check_room(10**8, "it")
    with pytest.raises(DataError, match=r"it claims .* TB, for which"):
        _room.check_room(10**18, "it")
    _room.check_density(10**9, 10**8, "it")
    with pytest.raises(DataError, match="claims 1 GB, but the file holds 10 bytes"):
        _room.check_density(10**9, 10, "it")
