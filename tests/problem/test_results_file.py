"""Results on disk: small, whole, and drawn again."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import small_problem
from backsight.cli import app
from backsight.errors import DataError
from backsight.problem import load, run_problem
from backsight.problem.results_file import read_estimates

INVOKE = CliRunner().invoke


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    text = small_problem.TEXT + "\n[output]\ncovariance = true\n"
    results = run_problem(
        load(small_problem.write(folder, text)), folder / "out", progress=lambda *_: None
    )
    return folder, results


def test_results_come_back_with_the_covariance_if_it_was_asked_for(folder):
    place, results = folder
    read = read_estimates(place / "out" / "estimates.nc")
    assert read.title == "Mass on a spring"
    assert "covariance = true" in read.problem
    for name, result in results.items():
        xr.testing.assert_identical(read.results[name], result)


def test_the_report_is_drawn_again_from_one_run_and_from_two(folder, tmp_path):
    place, _ = folder
    file = str(place / "out" / "estimates.nc")
    once = INVOKE(app, ["report", file, "--out", str(tmp_path / "again.html")])
    assert once.exit_code == 0, once.output
    page = (tmp_path / "again.html").read_text(encoding="utf-8")
    assert "<h1>Mass on a spring</h1>" in page
    other = tmp_path / "other"
    other.mkdir()
    (other / "estimates.nc").write_bytes((place / "out" / "estimates.nc").read_bytes())
    both = [file, str(other / "estimates.nc")]
    twice = INVOKE(app, ["report", *both, "--out", str(tmp_path / "both.html")])
    assert twice.exit_code == 0, twice.output
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    for name in ("out: EKF", "other: EKF", "out: MHO", "other: MHO"):
        assert name in page


def test_what_is_no_result_is_refused(tmp_path):
    (tmp_path / "text.nc").write_text("no numbers")
    xr.Dataset({"a": ("t", np.arange(3.0))}).to_netcdf(tmp_path / "root.nc", engine="h5netcdf")
    other = xr.Dataset({"a": ("t", np.arange(3.0))})
    other.to_netcdf(tmp_path / "group.nc", group="EKF", engine="h5netcdf")
    for name, message in {
        "text.nc": "cannot be read",
        "root.nc": "holds no results",
        "group.nc": "EKF has no variable 'x_hat'",
        "missing.nc": "cannot be read",
    }.items():
        with pytest.raises(DataError, match=message):
            read_estimates(tmp_path / name)
    refused = INVOKE(app, ["report", str(tmp_path / "root.nc"), "--out", str(tmp_path / "r.html")])
    assert refused.exit_code == 2
    assert not (tmp_path / "r.html").exists()
