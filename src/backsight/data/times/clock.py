"""Time stamps of any kind to seconds, exact to the nanosecond where they are whole numbers."""

import datetime
from typing import Any

import numpy as np
import pandas as pd

from backsight.data.times.dates import parsed
from backsight.errors import DataError
from backsight.types import Array

_DAY_OF_1970 = {"excel": 25569.0, "matlab": 719529.0, "julian": 2440587.5}
"""Day numbers of 1970-01-01: Excel counts from 1899-12-30 on, MATLAB from the year 0 on."""

_TICKS = {"unix": 1, "unix_ms": 10**3, "unix_us": 10**6, "unix_ns": 10**9, "ros": 10**9} | {
    "dotnet": 10**7,
    "filetime": 10**7,
}
"""Ticks per second since 1970-01-01T00:00 UTC, or since `_BEGIN`."""

_BEGIN = {"dotnet": -62135596800, "filetime": -11644473600}
"""Where .NET (year 1) and Windows (1601) begin to count, in seconds since 1970."""

NUMERIC = (*_DAY_OF_1970, *_TICKS)
"""Words of ``time_format`` for stamps that are numbers."""


EPOCHS = {"unix_ms": (5e11, 5e12), "unix_us": (5e14, 5e15), "unix_ns": (9e17, 5e18)} | {
    "dotnet": (6.2e17, 6.8e17),
    "filetime": (1.2e17, 1.7e17),
}
"""Where stamps that count fractions of seconds lie for dates of our time; no two overlap."""

DAYS = {"excel": (25e3, 75e3), "matlab": (7.2e5, 7.8e5), "julian": (2.44e6, 2.49e6)}
"""Where day numbers lie for dates of our time."""

_DAYLIKE = 1e-4
"""Steps of time up to which such a number may count days, of a sample every 8 s at most."""


def epoch_form(values: Any) -> str | None:
    """The `NUMERIC` form of numbers that can only be fractions of seconds since 1970, or None.

    As seconds they would be the year 17 000 and later.
    """
    array = np.asarray(values).ravel()
    if array.dtype.kind not in "fiu" or not array.size:
        return None
    return next((form for form, (low, high) in EPOCHS.items() if low < array[0] < high), None)


def maybe_days(values: np.ndarray) -> str | None:
    """The form of numbers that may be days as well as seconds, (n,), or None.

    A date with a time of day is a large number with small steps: 45352.4999 of a spreadsheet.
    """
    if values.dtype.kind != "f" or len(values) < 2:
        return None
    first, last = float(values[0]), float(values[-1])
    if not 0 < abs(last - first) <= _DAYLIKE * (len(values) - 1):
        return None
    return next((form for form, (low, high) in DAYS.items() if low < first < high), None)


def seconds(values: Any, *, time_format: str | None, where: str) -> tuple[Array, str]:
    """Time of every sample [s], (n,), and the date of its zero, "" if there is none.

    Dates count from the first one, so that no digit of the interval is lost in the year; intervals
    and numbers stay as they are.

    Parameters
    ----------
    values : (n,) array
        Numbers [s], or ``datetime64``, ``timedelta64``, dates of Python or pandas, or text.
    time_format : str, optional
        For numbers one of `NUMERIC`, for text a format of ``strptime``.
    where : str
        What messages begin with.

    Raises
    ------
    DataError
        If they are none of these, or text that could be read in several ways.
    """
    array = _plain(values)
    array = array if array.ndim == 1 else np.atleast_1d(np.squeeze(array))
    if array.dtype.kind == "O" or array.dtype.kind in "SU":
        array = _of_objects(array, time_format, where)
    if array.dtype.kind == "M":
        return _since_first(array)
    if array.dtype.kind == "m":
        return _seconds(array), ""
    if array.dtype.kind not in "fiub":
        raise DataError(f"{where}: time is of {array.dtype}; give numbers [s] or dates")
    if time_format is None:
        return np.asarray(array, float), ""
    return _of_numbers(array, time_format, where)


def _plain(values: Any) -> np.ndarray:
    """An array without time zone: dates with one become UTC."""
    if isinstance(values, pd.Series | pd.Index) and isinstance(values.dtype, pd.DatetimeTZDtype):
        index = pd.DatetimeIndex(values)
        return index.tz_convert("UTC").tz_localize(None).to_numpy()
    return np.asarray(values)


def _of_objects(array: np.ndarray, time_format: str | None, where: str) -> np.ndarray:
    first = next((v for v in array if v is not None and v == v), None)
    if isinstance(first, str | bytes):
        texts = [v.decode("latin-1") if isinstance(v, bytes) else v for v in array.tolist()]
        return parsed(pd.Series(texts, dtype=object), time_format, where)
    try:
        if isinstance(first, datetime.timedelta | np.timedelta64):
            return pd.to_timedelta(array).to_numpy()
        if isinstance(first, datetime.time):
            return parsed(pd.Series([str(v) for v in array], dtype=object), None, where)
        if isinstance(first, datetime.date | np.datetime64):
            return _plain(pd.DatetimeIndex(pd.to_datetime(array, utc=True)))
        return array.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{where}: time is not an array of numbers or dates: {error}") from None


def _since_first(stamps: np.ndarray) -> tuple[Array, str]:
    known = stamps[~np.isnat(stamps)]
    if not known.size:
        return np.full(len(stamps), np.nan), ""
    first = known[0]
    return _seconds(stamps - first), pd.Timestamp(first).isoformat()


def _seconds(intervals: np.ndarray) -> Array:
    """Whole ticks divided once: the float nearest to the true time."""
    unit, count = np.datetime_data(intervals.dtype)
    if unit == "generic" or unit in ("Y", "M"):
        return intervals.astype("timedelta64[s]").astype(float)
    if unit in ("s", "m", "h", "D", "W"):
        whole = intervals.astype("timedelta64[s]")
        return np.where(np.isnat(intervals), np.nan, whole.astype(np.int64).astype(float))
    per_second = {"ms": 10**3, "us": 10**6, "ns": 10**9, "ps": 10**12, "fs": 10**15, "as": 10**18}
    ticks = intervals.astype(np.int64)
    return np.where(np.isnat(intervals), np.nan, ticks * count / per_second[unit])


def _of_numbers(array: np.ndarray, time_format: str, where: str) -> tuple[Array, str]:
    if time_format not in NUMERIC:
        raise DataError(
            f"{where}: time holds numbers; as time_format give one of {', '.join(NUMERIC)}, "
            f"not '{time_format}'"
        )
    first = array[0] if len(array) else array.dtype.type(0)
    if time_format in _TICKS:
        per_second = _TICKS[time_format]
        ticks = array - first  # whole numbers stay exact
        since = float(first) / per_second + _BEGIN.get(time_format, 0)
        return ticks.astype(float) / per_second, _date(since)
    since = float(first) - _DAY_OF_1970[time_format]
    return (array.astype(float) - float(first)) * 86400.0, _date(since * 86400.0)


def _date(since_1970: float) -> str:
    try:
        moment = datetime.datetime.fromtimestamp(since_1970, datetime.UTC)
    except (OverflowError, ValueError, OSError):
        return ""
    return moment.replace(tzinfo=None).isoformat()
