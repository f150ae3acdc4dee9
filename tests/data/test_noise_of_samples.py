"""Noise of single samples in a recording: read, checked, resampled and merged."""

import numpy as np
import pytest

from backsight.data import Column, from_arrays, merge, read, resample
from backsight.errors import DataError

TABLE = "t,u,y,z,sigma,f\n0,1,2,7,0.2,1\n1,3,4,8,,2\n2,5,6,9,0.1,inf\n"
SIGNALS = {"inputs": {"F": "u"}, "outputs": {"q": "y", "v": "z"}, "time": "t"}


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "r.csv"
    file.write_text(TABLE, encoding="utf-8")
    return file


def recording(factor=None, *, dt=1.0, name="q"):
    return from_arrays(
        y=[0.0, 1.0, 2.0], inputs={}, outputs={name: "m"}, dt=dt, sigma_factor=factor
    )


def test_columns_of_a_file(path):
    """A factor, or the standard deviation by the nominal one; outputs without a column have 1."""
    both = read(path, **SIGNALS, sigma_factor={"q": Column("sigma", factor=10.0), "v": "f"})
    np.testing.assert_allclose(both.sigma_factor, [[2, 1], [np.nan, 2], [1, np.nan]])
    assert both.sigma_factor.dims == ("time", "output")
    one = read(path, **SIGNALS, sigma_factor={"v": "f"})
    np.testing.assert_array_equal(one.sigma_factor, [[1, 1], [1, 2], [1, np.nan]])
    assert "sigma_factor" not in read(path, **SIGNALS)


def test_a_part_of_a_file(path):
    part = read(path, **SIGNALS, start=1.0, sigma_factor={"v": "f"})
    np.testing.assert_array_equal(part.sigma_factor, [[1, 2], [1, np.nan]])


def test_an_unknown_output_is_refused_with_a_hint(path):
    with pytest.raises(DataError, match=r"sigma_factor: there is no output 'w': known: q, v"):
        read(path, **SIGNALS, sigma_factor={"w": "f"})


@pytest.mark.parametrize("bad", [0.0, -1.0, 1e-9])
def test_a_factor_must_be_positive(bad):
    with pytest.raises(DataError, match=r"sigma_factor of output 'q' is .* at sample 1"):
        recording([1.0, bad, 1.0])


def test_sizes_must_be_those_of_y():
    with pytest.raises(DataError, match="'sigma_factor' 2"):
        recording([1.0, 2.0])


def test_resampling_interpolates():
    finer = resample(recording([1.0, 3.0, np.inf]), 0.5)
    np.testing.assert_allclose(finer.sigma_factor[:, 0], [1, 2, 3, np.nan, np.nan])


def test_merging_keeps_the_factors_and_takes_one_for_the_others():
    slow = from_arrays(y=[0.0, 1.0], inputs={}, outputs={"p": "m"}, dt=2.0, sigma_factor=[2.0, 3.0])
    merged = merge(recording(), slow)
    assert list(merged.output.values) == ["q", "p"]
    np.testing.assert_array_equal(merged.sigma_factor, [[1, 2], [1, np.nan], [1, 3]])
    assert "sigma_factor" not in merge(recording(), recording(name="p"))
