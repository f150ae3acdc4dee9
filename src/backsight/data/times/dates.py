"""Dates and times as loggers write them, to ``datetime64`` or ``timedelta64``.

Told apart by the form of the first cells: ISO 8601, digits alone, day or month first, year first
with other signs, names of months, and clock times without date, which may go past midnight.
"""

import re

import numpy as np
import pandas as pd

from backsight.errors import DataError

_CLOCK = r"(?P<clock>\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?)(?P<half>\s*[AaPp][Mm])?"
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"
_ISO = re.compile(rf"\d{{4}}-\d{{2}}-\d{{2}}(?:[T ]{_CLOCK}{_ZONE})?")
_NUMBERS = re.compile(
    rf"(?P<a>\d{{1,4}})(?P<sign>[-/.])(?P<b>\d{{1,2}})(?P=sign)(?P<c>\d{{2,4}})"
    rf"(?:[T, ]\s*{_CLOCK}{_ZONE})?"
)
_MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
_NAMED = re.compile(
    rf"(?:(?P<a>\d{{1,2}})[-. ] ?)?(?P<month>{'|'.join(_MONTHS)})[a-z]{{0,6}}[-. ] ?"
    rf"(?:(?P<b>\d{{1,2}}),? )?(?P<year>\d{{4}}|\d{{2}})(?:[T, ]\s*{_CLOCK}{_ZONE})?",
    re.IGNORECASE,
)
_COMPACT = re.compile(
    r"(?P<year>(?:19|20)\d{2})(?P<month>0[1-9]|1[0-2])(?P<day>0[1-9]|[12]\d|3[01])[T_ ]?"
    rf"(?P<h>[01]\d|2[0-3])(?P<m>[0-5]\d)(?P<s>[0-5]\d)[.,]?(?P<f>\d*){_ZONE}"
)
"""Digits alone, also with T between date and time; never a plausible number of seconds."""

_TIME = re.compile(
    r"(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2}(?:[.,]\d+)?)(?:\s*(?P<half>[AaPp])[Mm])?"
)
_COLON = re.compile(r"(:\d{2}):(\d{3,9})(?![\d:])")
"""A colon before the fraction of a second."""

HALF_DAY = np.timedelta64(12, "h")


def is_date(cell: str) -> bool:
    """Whether a cell looks like a date or a clock time."""
    bare = _COLON.sub(r"\1.\2", cell.strip())
    return any(form.fullmatch(bare) for form in (_ISO, _NUMBERS, _COMPACT, _NAMED, _TIME))


def is_compact(cell: str) -> bool:
    """Whether a cell is a date of digits alone, which is a number as well."""
    return _COMPACT.fullmatch(cell) is not None


def parsed(cells: pd.Series, time_format: str | None, where: str) -> np.ndarray:
    """Read a column of dates, ``datetime64[ns]`` in UTC, or of clock times, ``timedelta64[ns]``.

    Parameters
    ----------
    cells : (n,) series of str
        An empty cell, or ``NaT``, is ``NaT``.
    time_format : str, optional
        A format of ``strptime``, as ``"%d.%m.%Y %H:%M:%S.%f"``.
    where : str
        What messages begin with.

    Raises
    ------
    DataError
        If a cell is no date, or if day and month could be either way and the order matters.
    """
    cells = cells.str.strip()
    known = cells.loc[~cells.isin(["", "NaT", "NaN", "nan", "NA"])]
    if known.empty:
        return np.full(len(cells), np.datetime64("NaT", "ns"))
    if time_format is not None:
        return _spread(_with_format(known, time_format, where), known, cells)
    if _COLON.search(known.iloc[0]):
        known = known.str.replace(_COLON, r"\1.\2", regex=True)
    first = known.iloc[0]
    if _TIME.fullmatch(first):
        return _spread(_clock_times(known, where), known, cells)
    if _ISO.fullmatch(first):
        # A comma before the fraction is ISO 8601, too, but not what pandas reads.
        points = known.str.replace(",", ".", regex=False)
        return _spread(_dates(points, "ISO8601", where), known, cells)
    if _COMPACT.fullmatch(first):
        return _spread(_dates(_separated(known, where), "ISO8601", where), known, cells)
    if named := _NAMED.fullmatch(first):
        numbered = known.map(_numbered)
        return _spread(_dates(*_joined(numbered, "%d-%m-%Y", named), where), known, cells)
    if numbers := _NUMBERS.fullmatch(first):
        return _spread(_in_order(known, numbers, where), known, cells)
    raise DataError(
        f"{where}: time begins with '{first}', which is no date that is known; give time_format, "
        "as in '%d.%m.%Y %H:%M:%S.%f'"
    )


def _numbered(cell: str) -> str:
    """``Mar 1, 2024 12:00`` as ``1-3-2024 12:00``; what is no such date stays as it is."""
    if (named := _NAMED.fullmatch(cell)) is None:
        return cell
    month = _MONTHS.index(named["month"].title()) + 1
    year = named["year"]
    if len(year) == 2:
        year = f"{'19' if int(year) > 68 else '20'}{year}"
    clock = f" {named['clock']}{named['half'] or ''}{named['zone'] or ''}" if named["clock"] else ""
    return f"{named['a'] or named['b'] or 1}-{month}-{year}{clock}"


def _separated(known: pd.Series, where: str) -> pd.Series:
    """``20240301T115959.7`` as ``2024-03-01T11:59:59.7``."""
    wrong = ~known.str.fullmatch(_COMPACT)
    if wrong.any():
        raise DataError(f"{where}: time is '{known.loc[wrong].iloc[0]}' among dates of digits")
    return known.str.replace(
        _COMPACT,
        lambda d: (
            f"{d['year']}-{d['month']}-{d['day']}T{d['h']}:{d['m']}:{d['s']}.{d['f'] or 0}"
            + (d["zone"] or "").replace("UTC", "Z").replace("GMT", "Z")
        ),
        regex=True,
    )


def _with_format(known: pd.Series, time_format: str, where: str) -> np.ndarray:
    stamps = _dates(known, time_format, where)
    if re.search(r"%[dDjyYcxmbB]", time_format):
        return stamps
    return _past_midnight(stamps - np.datetime64("1900-01-01", "ns"))


def _dates(known: pd.Series, time_format: str, where: str) -> np.ndarray:
    try:
        stamps = pd.to_datetime(known, format=time_format, utc=True)
    except (ValueError, OverflowError) as error:
        reason = str(error).partition("\n")[0].partition(". You might")[0]
        raise DataError(f"{where}: time is not written as '{time_format}': {reason}") from None
    return stamps.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")


def _in_order(known: pd.Series, form: re.Match[str], where: str) -> np.ndarray:
    """Dates of three numbers: the year is first if it has four digits, else last."""
    sign = form["sign"]
    if len(form["a"]) == 4:
        return _dates(*_joined(known, f"%Y{sign}%m{sign}%d", form), where)
    year = "%Y" if len(form["c"]) == 4 else "%y"
    days = known.str.extract(r"^(\d{1,2})[-/.](\d{1,2})[-/.](\d{2,4})")
    a, b = days[0].astype(float), days[1].astype(float)
    orders = {"day": f"%d{sign}%m{sign}{year}", "month": f"%m{sign}%d{sign}{year}"}
    if sign == "." or (a > 12).any():  # points are German, Russian, ...: the day is first
        order = "day"
    elif (b > 12).any():
        order = "month"
    elif not days.duplicated(keep="first").iloc[1:].all():
        raise DataError(
            f"{where}: in '{known.iloc[0]}' the day or the month may be first; give time_format, "
            f"'{orders['day']} ...' or '{orders['month']} ...'"
        )
    else:  # one day: the intervals are the same either way
        order = "day"
    return _dates(*_joined(known, orders[order], form), where)


def _joined(known: pd.Series, date: str, form: re.Match[str]) -> tuple[pd.Series, str]:
    """Cells and their format with one blank between date and time, and points in the seconds."""
    if not form["clock"]:
        return known, date
    day = known.str.extract(r"^(?P<day>\S+?|\d+ \w+ \d+)[T,\s]\s*(?P<clock>\d{1,2}:.*)$")
    cells = day["day"] + " " + day["clock"].str.replace(",", ".", regex=False)
    hour = "%I" if form["half"] else "%H"
    colons = form["clock"].count(":")
    clock = f"{hour}:%M" + (":%S" if colons == 2 else "")
    if cells.str.contains(".", regex=False).any() and re.search(r"[.,]", form["clock"]):
        clock += ".%f"
        # A recorder may leave out the fraction where it is zero.
        cells = cells.str.replace(r"(:\d{2}:\d{2})(?=$|\s|[Z+-])", r"\1.0", regex=True)
    if form["half"]:
        clock += " %p" if re.search(r"\s[AaPp]", form["half"]) else "%p"
    if form["zone"]:
        clock += "%z"
        cells = cells.str.replace(r"\s*(UTC|GMT)$", "Z", regex=True)
        cells = cells.str.replace(r"\s*(Z|[+-]\d{2}:?\d{2})$", r"\1", regex=True)
        cells = cells.str.replace(r"\s*([+-]\d{2})$", r"\g<1>00", regex=True)
    return cells, f"{date} {clock}"


def _clock_times(known: pd.Series, where: str) -> np.ndarray:
    parts = known.str.replace(",", ".", regex=False).str.extract(
        r"^(?:(?P<h>\d{1,2}):)?(?P<m>\d{1,2}):(?P<s>\d{1,2})(?:\.(?P<f>\d+))?"
        r"(?:\s*(?P<half>[AaPp])[Mm])?$"
    )
    wrong = parts["s"].isna()
    if wrong.any():
        raise DataError(f"{where}: time is '{known.loc[wrong].iloc[0]}' among clock times")
    if parts["h"].isna().all() and parts["f"].isna().all():
        raise DataError(
            f"{where}: time is '{known.iloc[0]}', hours or minutes first; give time_format, "
            "'%H:%M' or '%M:%S'"
        )
    nanoseconds = parts["f"].fillna("0").str.ljust(9, "0").str[:9].astype(np.int64)
    whole = parts[["h", "m", "s"]].fillna("0").astype(np.int64)
    if parts["half"].notna().any():
        whole["h"] = whole["h"] % 12 + 12 * parts["half"].isin(["P", "p"])
    total = (whole["h"] * 3600 + whole["m"] * 60 + whole["s"]) * 10**9 + nanoseconds
    return _past_midnight(total.to_numpy().astype("timedelta64[ns]"))


def _past_midnight(times: np.ndarray) -> np.ndarray:
    """Clock times that go on the next day: a step back by more than half a day is midnight."""
    back = np.diff(times, prepend=times[:1]) < -HALF_DAY
    return times + np.cumsum(back) * np.timedelta64(1, "D")


def _spread(values: np.ndarray, known: pd.Series, cells: pd.Series) -> np.ndarray:
    if len(known) == len(cells):
        return values
    spread = np.full(len(cells), np.array("NaT", values.dtype))
    spread[np.flatnonzero(cells.index.isin(known.index))] = values
    return spread
