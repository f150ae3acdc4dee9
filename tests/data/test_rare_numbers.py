"""Numbers and cells as they are rarely written, and units on the axis of a plot."""

import gzip
import zipfile

import numpy as np
import pytest

import backsight as bs
from backsight.errors import DataError


def read_cells(folder, cells, **options):
    path = folder / "run.csv"
    rows = [f"{k};{cell}" for k, cell in enumerate(cells)]
    path.write_text("\n".join(["t;q", *rows]), encoding="utf-8")
    recording = bs.read(path, time="t", inputs={}, outputs={"q": "q"}, **options)
    return recording.y.values.ravel()


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["\u22121.5", "2.5", "\u22120.25"], [-1.5, 2.5, -0.25]),
        (["1\u00a0234,5", "0,25", "\u22122\u00a0000,0"], [1234.5, 0.25, -2000.0]),
        (["1\u202f234,5", "0,25", "7,0"], [1234.5, 0.25, 7.0]),
        (["1\u2019234.5", "0.25", "7.0"], [1234.5, 0.25, 7.0]),
        (["1.5D-03", "-2.5d+01", "1.25-103"], [1.5e-3, -25.0, 1.25e-103]),
        (["1.5", "1.#QO", "-1.#J", "2.5"], [1.5, np.nan, np.nan, 2.5]),
        (["1.5", "#DIV/0!", "<NA>", "nan(ind)"], [1.5, np.nan, np.nan, np.nan]),
    ],
)
def test_numbers_are_read_as_they_are_meant(tmp_path, cells, numbers):
    np.testing.assert_array_equal(read_cells(tmp_path, cells), numbers)


def test_a_word_for_missing_is_proposed_as_it_is_said(tmp_path):
    with pytest.raises(DataError, match=r'say missing = \["OL"\]'):
        read_cells(tmp_path, ["1", "OL", "2"])

    np.testing.assert_array_equal(
        read_cells(tmp_path, ["1", "OL", "2"], missing=["OL"]), [1.0, np.nan, 2.0]
    )


@pytest.mark.parametrize("head", ["t / ms;q / mm", "t in ms;q in mm", "t [ms];q [mm]"])
def test_units_on_the_axis_of_a_plot_are_units(tmp_path, head):
    path = tmp_path / "run.csv"
    path.write_text(f"{head}\n0;1,5\n10;2,5\n20;3,5\n")

    recording = bs.read(path, time="t", inputs={}, outputs={"q": {"name": "q", "unit": "m"}})

    assert recording.attrs["dt"] == pytest.approx(0.01)
    np.testing.assert_allclose(recording.y.values.ravel(), [1.5e-3, 2.5e-3, 3.5e-3])


def test_what_a_recorder_reserved_and_did_not_use_is_left_off(tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(b"t,q\n0,1\n1,2\n2,3\n" + b"\0" * 64)

    assert bs.read(path, time="t", inputs={}, outputs={"q": "q"}).sizes["time"] == 3


def test_archives_are_opened_beside_what_systems_add_and_others_are_named(tmp_path):
    path = tmp_path / "run.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("run.csv", "t,q\n0,1\n1,2\n2,3\n")
        archive.writestr("__MACOSX/._run.csv", "x")
    assert bs.read(path, time="t", inputs={}, outputs={"q": "q"}).sizes["time"] == 3

    packed = tmp_path / "run.npy.gz"
    np.save(tmp_path / "run.npy", np.zeros(3))
    packed.write_bytes(gzip.compress((tmp_path / "run.npy").read_bytes()))
    with pytest.raises(DataError, match=r"a file of the kind '\.npy'; unpack it first"):
        bs.read(packed, dt=1.0, inputs={}, outputs={"q": "data"})


def test_a_delimiter_of_two_signs_is_refused_by_name(tmp_path):
    with pytest.raises(DataError, match="delimiter is '::'; give one sign"):
        read_cells(tmp_path, ["1", "2"], delimiter="::")
