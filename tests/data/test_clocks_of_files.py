"""What a column of time counts: dates, days, ticks, and units that only its name says."""

import datetime
from pathlib import Path

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError

N, DT = 24, 0.01
BEGIN = datetime.datetime(2024, 3, 1, 11, 59, 59, 900000)
STAMPS = [BEGIN + datetime.timedelta(seconds=DT * k) for k in range(N)]
POSITIONS = np.round(np.cos(0.3 * np.arange(N)), 4)


def read_with(folder: Path, cells, *, head: str = "t", **options):
    """Read a text whose column of time has these cells."""
    path = folder / "run.csv"
    rows = [f"{cell};{q:.4f}" for cell, q in zip(cells, POSITIONS, strict=True)]
    path.write_text("\n".join([f"{head};q", *rows]), encoding="utf-8")
    return bs.read(path, time=head, inputs={}, outputs={"q": "q"}, **options)


def milliseconds(stamp: datetime.datetime) -> str:
    return f"{stamp.microsecond // 1000:03d}"


FORMS = {
    "digits": lambda s: s.strftime("%Y%m%d%H%M%S") + milliseconds(s),
    "digits with T": lambda s: s.strftime("%Y%m%dT%H%M%S.") + milliseconds(s),
    "short zone": lambda s: s.isoformat(timespec="milliseconds") + "+01",
    "month first": lambda s: s.strftime("%b %d, %Y %H:%M:%S.") + milliseconds(s),
    "long month": lambda s: s.strftime("%d %B %Y %H:%M:%S.") + milliseconds(s),
    "two digits of the year": lambda s: s.strftime("%d-%b-%y %I:%M:%S.") + milliseconds(s) + " PM"
    if s.hour >= 12
    else s.strftime("%d-%b-%y %I:%M:%S.") + milliseconds(s) + " AM",
    "colon before the fraction": lambda s: s.strftime("%Y-%m-%d %H:%M:%S:") + milliseconds(s),
    "clock past noon": lambda s: s.strftime("%I:%M:%S.") + milliseconds(s) + s.strftime(" %p"),
    "ticks of .NET": lambda s: str((s - datetime.datetime(1, 1, 1)) // datetime.timedelta(
        microseconds=1) * 10),
    "ticks of Windows": lambda s: str((s - datetime.datetime(1601, 1, 1)) // datetime.timedelta(
        microseconds=1) * 10),
    "nanoseconds": lambda s: str((s - datetime.datetime(1970, 1, 1)) // datetime.timedelta(
        microseconds=1) * 1000),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_each_form_of_dates_gives_the_period_exactly(tmp_path, form):
    recording = read_with(tmp_path, map(FORMS[form], STAMPS))

    since = recording.time.values - recording.time.values[0]
    np.testing.assert_allclose(since, DT * np.arange(N), rtol=0, atol=1e-11)
    date = form not in ("clock past noon",)
    assert (recording.attrs.get("begin", "")[:10] == "2024-03-01") is date


@pytest.mark.parametrize(
    ("head", "factor"), [("t_ms", 1e-3), ("Time / us", 1e-6), ("time in ms", 1e-3), ("t_h", 3600.0)]
)
def test_a_unit_in_the_name_of_the_clock_counts(tmp_path, head, factor):
    cells = [f"{DT * k / factor:.12g}" for k in range(N)]

    by_name = read_with(tmp_path, cells, head=head)
    plain = read_with(tmp_path, cells, head="t")

    assert by_name.attrs["dt"] == pytest.approx(DT, rel=1e-9)
    assert plain.attrs["dt"] == pytest.approx(DT / factor, rel=1e-9)


def test_what_is_said_of_the_clock_wins_over_its_name(tmp_path):
    cells = [f"{DT * k:.2f}" for k in range(N)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["t_ms,q", *(f"{cell},0" for cell in cells)]))
    said = [{"name": "t_ms", "unit": "s"}, {"name": "t_ms", "factor": 1.0}]

    for clock in said:
        recording = bs.read(path, time=clock, inputs={}, outputs={"q": "q"})
        assert recording.attrs["dt"] == pytest.approx(DT)


@pytest.mark.parametrize("form", ["excel", "matlab", "julian"])
def test_numbers_that_may_be_days_are_refused_until_it_is_said(tmp_path, form):
    day = {"excel": 45352.5, "matlab": 739312.5, "julian": 2460371.0}[form]
    cells = [f"{day + k / 86400:.12f}" for k in range(N)]

    with pytest.raises(DataError, match=f'day numbers or seconds; say time_format = "{form}"'):
        read_with(tmp_path, cells)

    days = read_with(tmp_path, cells, time_format=form)
    assert days.attrs["dt"] == pytest.approx(1.0, rel=1e-4)
    assert days.attrs["begin"].startswith("2024-03-01T")
    found = bs.data.list_columns(tmp_path / "run.csv")
    assert found.time_format == form
    assert found.dt == pytest.approx(1.0, rel=1e-3)


def test_a_fast_clock_that_begins_late_is_taken_once_its_unit_is_said(tmp_path):
    cells = [f"{40000 + 1e-5 * k:.5f}" for k in range(N)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["t [s],q", *(f"{cell},0" for cell in cells)]))

    recording = bs.read(path, time="t", inputs={}, outputs={"q": "q"})

    assert recording.attrs["dt"] == pytest.approx(1e-5, rel=1e-4)


def test_dates_that_are_not_known_are_refused_with_the_word_that_helps(tmp_path):
    with pytest.raises(DataError, match="nor a date that is known; give time_format"):
        read_with(tmp_path, [s.strftime("%Y-%j %H:%M:%S.%f") for s in STAMPS])
