"""Texts as loggers and spreadsheets write them: numbers, dates, units, what stands around."""

import bz2
import gzip
import lzma
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from backsight.data import read
from backsight.errors import DataError

ROWS = [(0.0, 0.25), (0.1, 1.5), (0.2, -2.75), (0.3, 1234.5)]
POINTS = "\n".join(f"{t},{y}" for t, y in ROWS)


@pytest.fixture
def values(tmp_path):
    """Time and values of a text with the columns t and y."""

    def _values(text, name="r.csv", **more):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        given = {"time": "t", "outputs": {"y": "y"}, **more}
        r = read(path, inputs={}, **given)
        return r.time.to_numpy(), r.y.to_numpy()[:, 0], r

    return _values


LAYOUTS = {
    "decimal commas": "t;y\n" + POINTS.replace(",", ";").replace(".", ","),
    "decimal commas, blanks": "t y\n" + POINTS.replace(",", " ").replace(".", ","),
    "decimal commas in quotes": "t,y\n"
    + "".join(f'"{t}","{y}"\n'.replace(".", ",") for t, y in ROWS),
    "thousands, points": "t;y\n0,0;0,25\n0,1;1,5\n0,2;-2,75\n0,3;1.234,5",
    "thousands, quoted": 't,y\n0.0,0.25\n0.1,1.5\n0.2,-2.75\n0.3,"1,234.5"',
    "bars": "t|y\n" + POINTS.replace(",", "|"),
    "a line of units": "t,y\ns,m/s^2\n" + POINTS,
    "units in brackets": "t\ty\n(s)\t(m/s2)\n" + POINTS.replace(",", "\t"),
    "a line of units, not of all": "t,y\n,mm\n" + POINTS + "\nEnd,\n",
    "units behind names": "t [s],y [kN]\n" + POINTS,
    "units behind names, blanks": "t [s] y [kN]\n" + POINTS.replace(",", " "),
    "a preamble": "Logger 3000\nserial;17\nRate 10 Hz\nt,y\n" + POINTS,
    "a preamble and units": "Run\nof today\n\nt,y\ns,mm\n" + POINTS,
    "a footer": "t,y\n" + POINTS + "\nOverflows none\nEnd\n",
    "statistics with a title": "t,y\n" + POINTS + "\nStatistics\nMean,0.123\nMax,1.5\n",
    "statistics, apart": "t,y\n" + POINTS + "\n\nMean,0.123\nMax,1.5\n",
    "statistics behind a blank line": "t,y\n" + POINTS + "\n\nMean,0.5\n",
    "statistics": "t,y\n" + POINTS + "\nMin,-2.75\nMax,1.5\n\nEnd\n",
    "percent comments": "% made by\n% t,y\n" + POINTS,
    "names in a middle comment": "! Comment\n! t y\n! Comment\n" + POINTS.replace(",", " "),
    "names and units in comments": "# t y\n# s m\n" + POINTS.replace(",", " "),
    "comments with the sign of a comment in text": "t,note,y\n"
    + "\n".join(f"{t},run #{k},{y}" for k, (t, y) in enumerate(ROWS)),
    "a quote that is not closed": "t,y,note\n" + POINTS.replace("1.5", '1.5,"open') + ',x"\n',
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_numbers(values, layout):
    time, y, _ = values(LAYOUTS[layout])
    np.testing.assert_array_equal(time, [t for t, _ in ROWS])
    np.testing.assert_array_equal(y, [y for _, y in ROWS])


@pytest.mark.parametrize(
    ("layout", "unit"),
    [
        ("a line of units", "m/s^2"),
        ("units in brackets", "m/s2"),
        ("units behind names", "kN"),
        ("units behind names, blanks", "kN"),
        ("names and units in comments", "m"),
    ],
)
def test_units_in_the_file_are_those_of_the_signals(values, layout, unit):
    assert values(LAYOUTS[layout])[2].output_unit.item() == unit
    given = values(LAYOUTS[layout], outputs={"y": {"name": "y", "unit": "g"}})[2]
    assert given.output_unit.item() == "g"
    scaled = values(LAYOUTS[layout], outputs={"y": {"name": "y", "factor": 2.0}})[2]
    assert scaled.output_unit.item() == ""


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        ("a footer", "the end left off: 'Overflows none'"),
        ("statistics with a title", "the end left off: 'Statistics'"),
        ("statistics behind a blank line", "the end left off: 'Mean,0.5'"),
        ("statistics", "the end left off: 'Min,-2.75'"),
        ("a preamble", "3 lines before the names left off"),
        ("decimal commas", "decimal sign ','"),
        ("thousands, quoted", "thousands ','"),
    ],
)
def test_what_was_understood_is_said(values, layout, words):
    assert words in values(LAYOUTS[layout])[2].attrs["understood"]


def test_a_plain_text_needs_no_words(values):
    assert "understood" not in values("t,y\n" + POINTS)[2].attrs


def test_a_word_in_the_last_row_alone_is_no_footer(values):
    with pytest.raises(DataError, match="'ERR' is not a number"):
        values("t,y\n" + POINTS + "\nERR,8\n")


@pytest.mark.parametrize(
    ("text", "more", "expected"),
    [
        ("0,25\n0,50\n0,75\n", {}, [0.25, 0.5, 0.75]),
        ("y\n1,5\n2,25\n", {"outputs": {"y": "y"}}, [1.5, 2.25]),
        ("1,5\n2,25\n3,1\n", {"decimal": ","}, [1.5, 2.25, 3.1]),
        ("1,5\n2,25\n3,1\n", {"delimiter": ","}, [1, 2, 3]),
        ("1,5\n2,25\n", {"outputs": {"y": "1"}}, [5, 25]),
        ("1,05\n2,25\n", {}, [1.05, 2.25]),
    ],
)
def test_a_column_alone(values, text, more, expected):
    given = {"outputs": {"y": "0"}, "time": None, "dt": 1.0, **more}
    np.testing.assert_array_equal(values(text, **given)[1], expected)


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("1,5\n2,25\n3,1\n", {"outputs": {"y": "0"}, "time": None, "dt": 1.0}, "may be one number"),
        ("t;y\n0;1,234\n1;2,345\n", {}, "'1,234' may be 1234 or 1.234"),
        ("t;y\n0;1,5\n1;2.5\n", {}, "points and commas in several ways"),
        ("t,y\n0,1\n1,OOPS\n2,3\n", {}, "line 3, column 'y': 'OOPS' is not a number"),
        ("t u y\n0 1 2\n1  3\n2 4 5\n", {}, "line 3 has 2 cells.*not plain which are missing"),
        ("t,y\n0,True\n1,True\n", {}, "line 2, column 'y': 'True' is not a number"),
        ("t,y\n0,1\n1,2\nMean,1.5\n", {}, "line 4, column 't': 'Mean'"),
        ("t,y\n0,1\n1,2\n", {"encoding": "klingon"}, "there is no encoding 'klingon'"),
        ("t,y\n0,1\n1,2\n", {"format": "xyz"}, "there is no format 'xyz'"),
        ("t,y\n1/2/2026 1:00,1\n2/3/2026 1:00,2\n", {}, "the day or the month may be first"),
        ("t,y\n10:00,1\n10:01,2\n", {}, "hours or minutes first; give time_format"),
        ("t,y\nsoon,1\nlater,2\n", {}, "there is no column|not a number"),
        ("t,y\n13,1\n14,2\n", {"time_format": "excle"}, "time"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused(values, text, more, message):
    with pytest.raises(DataError, match=message):
        values(text, **more)


def test_codes_for_missing_values(values):
    text = "t,y\n0.0,1.5\n0.1,OVERLOAD\n0.2,null\n0.3,-999\n0.4,ERR\n0.5,-999.0\n"
    _, y, _ = values(text, missing=[-999, "ERR"])
    np.testing.assert_array_equal(y, [1.5, *[np.nan] * 5])
    _, y, _ = values(text, missing=["ERR"])
    np.testing.assert_array_equal(y, [1.5, np.nan, np.nan, -999, np.nan, -999])


def test_numbers_of_windows(values):
    _, y, _ = values("t,y\n0.0,1.5\n0.1,1.#QNAN\n0.2,-1.#IND\n")
    np.testing.assert_array_equal(y, [1.5, np.nan, np.nan])


DATES = {
    "ISO": ["2026-03-27T23:59:59.{:03d}", "2026-03-28T00:00:00.{:03d}"],
    "ISO, blank, zone": ["2026-03-27 23:59:59,{:03d}+02:00", "2026-03-28 00:00:00,{:03d}+02:00"],
    "ISO, UTC": ["2026-03-27T23:59:59.{:03d}Z", "2026-03-28T00:00:00.{:03d}Z"],
    "day first": ["27/03/2026 23:59:59,{:03d}", "28/03/2026 00:00:00,{:03d}"],
    "month first": ["03/27/2026 11:59:59.{:03d} PM", "03/28/2026 12:00:00.{:03d} AM"],
    "points": ["27.03.26 23:59:59.{:03d}", "28.03.26 00:00:00.{:03d}"],
    "year first": ["2026/03/27 23:59:59.{:03d}", "2026/03/28 00:00:00.{:03d}"],
    "named month": ["27-Mar-2026 23:59:59.{:03d}", "28-Mar-2026 00:00:00.{:03d}"],
    "clock": ["23:59:59.{:03d}", "00:00:00.{:03d}"],
}


@pytest.mark.parametrize("form", DATES)
def test_dates_and_times_past_midnight(values, form):
    before, after = DATES[form]
    stamps = [before.format(900), before.format(950), after.format(0), after.format(50)]
    text = "t;y\n" + "".join(f"{stamp};{k}\n" for k, stamp in enumerate(stamps))
    time, _, r = values(text)
    np.testing.assert_allclose(time - time[0], [0, 0.05, 0.1, 0.15], atol=1e-12)
    assert ("begin" in r.attrs) == (form != "clock")


@pytest.mark.parametrize(
    ("time_format", "stamps", "step"),
    [
        ("excel", ["45000.5", "45000.50001", "45000.50002"], 0.864),
        ("matlab", ["739000.5", "739000.50001", "739000.50002"], 0.864),
        ("unix_ns", ["1711583999900000001", "1711583999900000101", "1711583999900000201"], 1e-7),
        ("ros", ["1711583999900000001", "1711583999900000101", "1711583999900000201"], 1e-7),
        ("unix_ms", ["1711583999900", "1711583999901", "1711583999902"], 1e-3),
        ("%d.%m.%Y %H:%M", ["27.03.2026 23:59", "28.03.2026 00:00", "28.03.2026 00:01"], 60.0),
        ("%Y%m%d-%H%M%S", ["20260327-235959", "20260328-000000", "20260328-000001"], 1.0),
    ],
)
def test_declared_formats_of_time(values, time_format, stamps, step):
    text = "t;y\n" + "".join(f"{stamp};1\n" for stamp in stamps)
    time, _, r = values(text, time_format=time_format)
    np.testing.assert_allclose(time, np.arange(3) * step, rtol=1e-5)  # a day number has 10 us
    assert r.attrs["begin"].startswith("20")


def test_one_day_needs_no_order_of_day_and_month(values):
    text = "t,y\n" + "".join(f"03/04/2026 10:00:0{k},{k}\n" for k in range(4))
    np.testing.assert_array_equal(values(text)[0], [0, 1, 2, 3])


@pytest.mark.parametrize("kind", ["gz", "bz2", "xz", "zip"])
def test_packed_texts(values, kind, tmp_path):
    text = ("t,y\n" + POINTS).encode()
    if kind == "zip":
        with zipfile.ZipFile(tmp_path / "made.zip", "w") as archive:
            archive.writestr("r.csv", text)
        packed = (tmp_path / "made.zip").read_bytes()
    else:
        packed = {"gz": gzip, "bz2": bz2, "xz": lzma}[kind].compress(text)
    np.testing.assert_array_equal(values(packed, f"r.csv.{kind}")[1], [y for _, y in ROWS])
    with pytest.raises(DataError, match=r"r\.csv"):
        values(packed[: len(packed) // 2], f"r.csv.{kind}")


def test_a_packed_text_that_would_fill_the_memory_is_refused(values):
    bomb = bz2.compress(b"t,y\n" + b"0" * (80 << 20))
    with pytest.raises(DataError, match="the packed text claims"):
        values(bomb, "r.csv.bz2")


@pytest.mark.parametrize("name", ["r.dat", "r.mat", "r", "r.log"])
def test_content_decides_and_format_overrides(values, name):
    np.testing.assert_array_equal(values("t,y\n" + POINTS, name)[1], [y for _, y in ROWS])
    np.testing.assert_array_equal(
        values("t,y\n" + POINTS, name, format="text")[1], [y for _, y in ROWS]
    )


def test_the_line_of_names_may_be_said(values):
    text = "5,6\nt,y\n0,1\n1,2\n"
    np.testing.assert_array_equal(values(text, header=2)[1], [1, 2])
    given = {"outputs": {"y": "1"}, "time": "0"}
    np.testing.assert_array_equal(values("0,1\n1,2\n", header=0, **given)[1], [1, 2])


def test_the_page_on_files_runs(capsys):
    """Every example of docs/your-file.md, one after the other."""
    page = Path(__file__).parents[2] / "docs" / "your-file.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    exec("\n".join(blocks), {})
    said = capsys.readouterr().out
    assert "2026-03-27T10:51:00 0.1 mm" in said
    assert "not plain which axis is time" in said
    assert "0.001024 time is rounded to 0.001 s" in said
