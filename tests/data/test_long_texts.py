"""Long texts are read by polars: the same numbers, to the last bit, and the same refusals."""

import numpy as np
import pytest

from backsight.data import read
from backsight.data.texts import _fast
from backsight.errors import DataError

pytest.importorskip("polars")
GIVEN = {"dt": 0.1, "inputs": {}, "outputs": {"a": "a", "b": "b"}}


@pytest.fixture
def fast(monkeypatch):
    """Every text counts as long; counts the tables that came from polars."""
    taken = []
    by_polars = _fast._by_polars

    def counted(*arguments):
        table = by_polars(*arguments)
        taken.append(table is not None)
        return table

    monkeypatch.setattr(_fast, "_LONG", 0)
    monkeypatch.setattr(_fast, "_by_polars", counted)
    return taken


def written(tmp_path, rows, head="a,b"):
    path = tmp_path / "long.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_numbers_are_rounded_as_python_does(tmp_path, fast):
    rng = np.random.default_rng(3)
    a = rng.standard_normal(2000) * 10.0 ** rng.integers(-30, 30, 2000)
    forms = ["{:.25g}", "{!r}", "{:.3f}", "{:.17e}", "{:.0f}", "  {:.6g}"]
    cells = [forms[k % 6].format(float(v)) for k, v in enumerate(a)]
    cells += ["5e-324", "1.7976931348623157e308", "9007199254740993", ".5", "5.", "-0"]
    path = written(tmp_path, [f"{cell},{k}" for k, cell in enumerate(cells)])
    recording = read(path, **GIVEN)
    assert fast == [True]
    assert recording.y.values[:, 0].tolist() == [float(cell) for cell in cells]


@pytest.mark.parametrize(
    "rows",
    [
        ["1,2", "3,", ",nan", "NA,4", "OVERLOAD,5"],  # missing cells
        ["+1,2", "3,4"],  # a sign that not all parsers take
        ["1 ,2", "3, 4"],  # blanks around numbers
        ["1,2", "", "3,4"],  # blank lines
        ["1,2,", "3,4,"],  # a delimiter at the end
        ["1,2", "3", "4,5"],  # a short line
        ['1,"2"', "3,4"],  # quotes
        ["1,2 # here", "# 1,2", "3,4"],  # comments
        ["1,2", "3,4", "end of measurement"],  # a footer
        ["1,1.#QNAN", "3,4"],  # words of older Windows
    ],
)
@pytest.mark.parametrize("more", [False, True])
def test_other_cells_are_read_as_the_careful_parser_does(tmp_path, monkeypatch, fast, rows, more):
    if more:  # a column that is not wanted
        rows = [f"{row},x" if row and row[-1] != "," and row[0] != "e" else row for row in rows]
    path = written(tmp_path, rows, "a,b,c" if more else "a,b")

    def result():
        try:
            return read(path, **GIVEN).y.values.tolist()
        except DataError as error:
            return str(error)

    quick = result()
    monkeypatch.setattr("backsight.data.texts.reading.parsed_fast", lambda *_: None)
    np.testing.assert_equal(quick, result())


def test_faults_are_named_by_line_and_column(tmp_path, fast):
    with pytest.raises(DataError, match="line 4, column 'b': 'x' is not a number"):
        read(written(tmp_path, ["1,2", "3,4", "5,x", "6,7"]), **GIVEN)
    with pytest.raises(DataError, match="line 3 has 3 cells, but there are 2 columns"):
        read(written(tmp_path, ["1,2", "3,4,5", "5,6"]), **GIVEN)


def test_other_signs_and_ticks_of_a_clock(tmp_path, fast):
    path = written(
        tmp_path, [f"{1_700_000_000_000_000_001 + 10**6 * k};{k},25" for k in range(9)], "t;a"
    )
    recording = read(path, time="t", time_format="unix_ns", inputs={}, outputs={"a": "a"})
    assert fast == [True]
    assert recording.attrs["dt"] == 1e-3
    assert recording.y.values[:, 0].tolist() == [k + 0.25 for k in range(9)]
