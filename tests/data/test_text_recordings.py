"""Text files: layouts that loggers write, and the message for every cell that is wrong."""

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.data import Column, read
from backsight.errors import DataError

LAYOUTS = {
    "comma": "t,u,y\n0,1,2\n1,3,\n2,5,6\n",
    "semicolon": "t;u;y\n0;1;2\n1;3;\n2;5;6\n",
    "tab": "t\tu\ty\n0\t1\t2\n1\t3\t\n2\t5\t6\n",
    "blanks": "t u y\n0 1 2\n1  3 nan\n 2 5 6\n",
    "header in a comment": "# made by a logger\n# t,u,y\n0,1,2\n1,3,nan\n2,5,6\n",
    "comments and blank lines": "\n# a\nt, u, y\n\n0, 1, 2\n# b\n1, 3, NaN # c\n2, 5, 6\n",
    "delimiter at the end": "t,u,y,\n0,1,2,\n1,3,,\n2,5,6,\n",
    "quotes": '"t","u","y"\n0,"1",2\n1,3,\n2,5,6\n',
    "blanks around numbers": "t,u,y\n0,1 ,2 \n1,3,nan \n2, 5 ,6\n",
    "windows": "t,u,y\r\n0,1,2\r\n1,3,\r\n2,5,6\r\n",
    "old macintosh": "t,u,y\r0,1,2\r1,3,\r2,5,6\r",
    "an indented comment": "t,u,y\n0,1,2\n  # b\n1,3,\n \n2,5,6\n",
    "other delimiters in text": "t,note,u,y\n0,a;b,1,2\n1,,3,\n2,c;d,5,6\n",
    "a short last cell": "t,u,y\n0,1,2\n1,3\n2,5,6\n",
    "other columns of text": "t,note,u,y\n0,start,1,2\n1,,3,\n2,stop now,5,6\n",
}


@pytest.fixture
def write(tmp_path):
    def _write(text, name="r.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(text.encode(encoding))
        return path

    return _write


def recording(path, **more):
    return read(path, inputs={"F": "u"}, outputs={"q": "y"}, time="t", **more)


def test_tabs_alone_are_a_row_of_missing_cells(write):
    text = "u\ty\n1\t2\n\t\n# c\n3\tnan \n"
    r = read(write(text), inputs={}, outputs={"u": "u", "y": "y"}, dt=1.0)
    np.testing.assert_array_equal(r.y, [[1, 2], [np.nan, np.nan], [3, np.nan]])


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_recording(write, layout):
    r = recording(write(LAYOUTS[layout]))
    np.testing.assert_array_equal(r.time, [0, 1, 2])
    np.testing.assert_array_equal(r.u, [[1], [3], [5]])
    np.testing.assert_array_equal(r.y, [[2], [np.nan], [6]])
    assert r.attrs["dt"] == 1


def test_byte_order_mark_is_not_part_of_the_first_name(write):
    assert recording(write(LAYOUTS["comma"], encoding="utf-8-sig")).sizes["time"] == 3


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_beyond_ascii(write, encoding):
    path = write("t,Spannung °,Weg µm\n0,1,2\n1,3,4\n", encoding=encoding)
    r = read(path, inputs={"V": "Spannung °"}, outputs={"q": "Weg µm"}, time="t")
    np.testing.assert_array_equal(r.y, [[2], [4]])


def test_columns_without_names_are_numbered_from_zero(write):
    r = read(write("1 2\n3 4\n", "r.txt"), inputs={"F": "0"}, outputs={"q": "1"}, dt=0.5)
    np.testing.assert_array_equal(r.u, [[1], [3]])
    np.testing.assert_array_equal(r.time, [0, 0.5])


def test_lines_at_the_top_are_skipped(write):
    path = write("Logger 3000\nserial 17;4\n" + LAYOUTS["comma"])
    assert recording(path, skip_lines=2).sizes["time"] == 3


@given(
    table=hnp.arrays(
        float, (4, 3), elements=st.floats(allow_nan=False, allow_infinity=False, width=64)
    )
)
def test_numbers_come_back_as_written(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("numbers") / "r.csv"
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header="a,b,c")
    r = read(path, inputs={}, outputs={n: n for n in "abc"}, dt=1.0)
    # Before version 3, pandas may be wrong in the last digit.
    np.testing.assert_allclose(r.y, table, rtol=5e-16)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,u,y\n0,1,2\n\n# c\n1,abc,4\n", "line 5, column 'u': 'abc' is not a number$"),
        ("t;u;y\n0;1;2.5\n1;1;4,5\n", "points and commas in several ways; say decimal"),
        ("t;u;y\n0;1;1,234\n1;1;4,567\n", "'1,234' may be 1234 or 1.234; say decimal"),
        ("t,u,y\n0,1,2\n1,True,4\n", "line 3, column 'u': 'True' is not a number"),
        ("t,u,y\n0,1,2\n1,1_0,4\n", "line 3, column 'u': '1_0' is not a number"),
        ("t,u,y\n0,1,2\n1,2,3,4\n", "line 3 has 4 cells, but there are 3 columns"),
        ("t,u,y\n0,1,2,3\n1,2,3,4\n", "names has 3 cells, the first line of numbers 4"),
        ("t,u,u,y\n0,1,2,3\n1,2,3,4\n", "2 columns are called 'u'"),
        ("t,u,yy\n0,1,2\n1,1,2\n", "no column 'y': did you mean 'yy'"),
        ("t,v,z\n0,1,2\n1,1,2\n", "no column 'u': known: t, v, z; there is no column 'y'"),
        ("t,u,y\n", "0 samples; at least 2"),
        ("t,u,y\n0,1,2\n", "1 samples; at least 2"),
        ("", "no column 'u': there are none"),
        ("t,u,y\n0,,2\n1,3,4\n", r"input 'F' is nan at sample 0 \(t = 0 s\)"),
        ("t,u,y\n0,1,2\n1,2\0,4\n", "line 3, column 'u'"),
        ("t,u\0,y\n0,1,2\n", "not plain text"),
    ],
)
def test_what_is_wrong_is_named(write, text, message):
    path = write(text)
    with pytest.raises(DataError, match=message) as caught:
        recording(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.filterwarnings("ignore")
def test_cells_too_many_are_refused_also_where_warnings_are_not_errors(write):
    with pytest.raises(DataError, match="line 3 has 4 cells"):
        recording(write("t,u,y\n0,1,2,\n1,2,3,4\n"))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252"])
def test_other_encodings_are_recognised(write, encoding):
    text = LAYOUTS["comma"].replace("t,u,y", "t,u,y,µ") + "3,7,8,9\n"
    assert recording(write(text, encoding=encoding)).sizes["time"] == 4


def test_a_wrong_cell_in_a_column_that_is_not_read_does_not_matter(write):
    path = write("t,u,y\n0,oops,2\n1,1,4\n")
    r = read(path, inputs={}, outputs={"q": Column("y", unit="m", factor=1e-3)}, time="t")
    np.testing.assert_allclose(r.y, [[2e-3], [4e-3]])
