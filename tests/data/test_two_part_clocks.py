"""Dates and times of the day in two columns, and workbooks that begin with a cover."""

import datetime as dt

import numpy as np
import pytest
from typer.testing import CliRunner

from backsight.cli import app
from backsight.data import list_columns, read

BEGIN = dt.datetime(2024, 3, 5, 23, 0)
ROWS = [BEGIN + k * dt.timedelta(minutes=10) for k in range(12)]
Y = np.sin(np.arange(12.0))


@pytest.mark.parametrize(
    ("head", "day", "hour"),
    [("Datum;Uhrzeit;y", "%d.%m.%y", "%H:%M"), ("Date;Time;y", "%Y-%m-%d", "%H:%M:%S")],
)
@pytest.mark.parametrize("swapped", [False, True])
def test_two_columns_are_one_clock(tmp_path, head, day, hour, swapped):
    file = tmp_path / "two.csv"
    names = head.split(";")
    cells = [[f"{t:{day}}", f"{t:{hour}}", f"{y:.6f}"] for t, y in zip(ROWS, Y, strict=True)]
    order = [1, 0, 2] if swapped else [0, 1, 2]
    lines = [";".join(row[i] for i in order) for row in [names, *cells]]
    file.write_text("\n".join(lines) + "\n")
    clock = f"{names[0]} + {names[1]}"
    assert list_columns(file).clock == clock
    r = read(file, inputs={}, outputs={"y": "y"}, time=clock)
    assert r.attrs["dt"] == pytest.approx(600)
    assert r.attrs["begin"] == "2024-03-05T23:00:00"
    np.testing.assert_allclose(r["y"].values[:, 0], Y, atol=1e-6)


def test_dates_that_do_not_rise_are_told(tmp_path):
    file = tmp_path / "days.csv"
    file.write_text("Date,y\n" + "".join(f"05.03.2024,{k}\n" for k in range(9)))
    ran = CliRunner().invoke(app, ["columns", str(file)], catch_exceptions=False)
    assert ran.exit_code == 0
    assert "does not rise from row to row" in " ".join(ran.output.split())


def test_the_cover_of_a_workbook_is_passed_over(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Test bench 7", "made in", 2024])
    sheet = book.create_sheet("Data")
    for row in (["Report"], [], ["day", "clock", "y"]):
        sheet.append(row)
    for t, y in zip(ROWS, Y, strict=True):
        sheet.append([dt.datetime(t.year, t.month, t.day), t.time(), float(y)])
    book.save(tmp_path / "r.xlsx")
    r = read(tmp_path / "r.xlsx", inputs={}, outputs={"y": "y"}, time="day + clock")
    assert r.attrs["dt"] == pytest.approx(600)
    assert "sheet 'Data'" in r.attrs["understood"]
    np.testing.assert_allclose(r["y"].values[:, 0], Y)
