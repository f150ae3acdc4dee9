"""What a run writes."""

import json
import math

import numpy as np
import pytest
import xarray as xr

import small_problem
from backsight.errors import ProblemError
from backsight.estimators import EKF, MHO
from backsight.problem import load, run_problem
from backsight.problem.recorded import recording_of
from backsight.schema import check_estimates


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    steps = []
    results = run_problem(
        load(small_problem.write(folder)), folder / "out", progress=lambda *s: steps.append(s)
    )
    return folder / "out", results, steps


def test_every_result_is_a_group_that_reads_back_the_same(out):
    folder, results, _ = out
    for name, result in results.items():
        with xr.open_dataset(folder / "estimates.nc", group=name) as read:
            check_estimates(read, name)
            xr.testing.assert_equal(read, result.drop_vars("P"))
            assert read.attrs == result.attrs
    with xr.open_dataset(folder / "estimates.nc") as root:
        assert root.attrs["problem"] == small_problem.TEXT


def test_parameters_are_found_and_summed_up(out):
    folder, results, _ = out
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["problem"]["title"] == "Mass on a spring"
    assert written["problem"]["samples"] == small_problem.SAMPLES
    assert list(written["estimators"]) == ["EKF", "MHO"]
    for name, entry in written["estimators"].items():
        for parameter, true in (("k", small_problem.STIFFNESS), ("b", small_problem.DAMPING)):
            final = entry["final"][parameter]
            assert final["value"] == float(results[name]["x_hat"].sel(state=parameter)[-1])
            assert math.isclose(final["value"], true, rel_tol=0.02)
            assert math.isclose(final["relative_error"], final["value"] / true - 1, abs_tol=1e-12)
            assert final["reference"] == true
        assert entry["final"]["k"]["unit"] == "1/s2"
        assert {"mean_nis", "us_per_sample", "status"} <= set(entry)
        assert entry["failure"] is None


def test_the_report_is_written_unless_it_is_not_wanted(out, tmp_path):
    folder, _, _ = out
    assert sorted(p.name for p in folder.iterdir()) == [
        ".backsight.json",
        "estimates.nc",
        "report.html",
        "summary.json",
    ]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Mass on a spring" in page
    assert "sigma_y = { y = 1e-4 }" in page
    problem = load(small_problem.write(tmp_path, small_problem.TEXT + "[output]\nreport = false\n"))
    run_problem(problem, tmp_path / "out", progress=lambda *_: None)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        ".backsight.json",
        "estimates.nc",
        "summary.json",
    ]


def test_progress_ends_with_all_samples(out):
    _, _, steps = out
    n = small_problem.SAMPLES
    assert [s for s in steps if s[1] == n] == [("EKF", n, n), ("MHO", n, n)]


def test_an_estimator_may_smooth_the_recording(tmp_path):
    wanted = 'kind = "ekf"\n'
    text = small_problem.TEXT.replace(wanted, wanted + "smooth = true\n")
    results = run_problem(
        load(small_problem.write(tmp_path, text)), tmp_path / "out", progress=lambda *_: None
    )
    known = results["EKF"]
    check_estimates(known, "EKF")
    assert known.attrs["smoothed"] == 1
    assert "smoothed" not in results["MHO"].attrs
    assert (known["x_std"].sel(state="k") <= known["x_std"].sel(state="k")[-1] * 1.001).all()
    windowed = text.replace('kind = "mho"\n', 'kind = "mho"\nsmooth = true\n')
    problem = load(small_problem.write(tmp_path, windowed))
    with pytest.raises(ProblemError, match=r"estimators\.MHO: .* no smoother"):
        run_problem(problem, tmp_path / "refused", progress=lambda *_: None)
    assert not (tmp_path / "refused").exists()


def test_the_recording_is_read_as_the_file_says(tmp_path, monkeypatch):
    monkeypatch.setenv("MY_DATA", str(tmp_path))
    text = small_problem.changed(
        'path = "spring.csv"', 'path = "${MY_DATA}/spring.csv"\nstart = 0.5'
    )
    text = text.replace('column = "place"', 'column = "place", factor = 2.0, offset = 1.0')
    text = text.replace('time = "t"', 'time = { column = "t", factor = 10.0 }')
    problem = load(small_problem.write(tmp_path, text))
    results = run_problem(problem, tmp_path / "out", progress=lambda *_: None, env=["MY_DATA"])
    table = small_problem.table()
    kept = 10 * table[:, 0] >= 0.5
    np.testing.assert_allclose(results["EKF"]["y"].values[:, 0], 2 * table[kept, 2] + 1)
    np.testing.assert_allclose(results["EKF"]["time"].values, 10 * table[kept, 0])


def test_how_the_file_is_written_may_be_said(tmp_path):
    keys = """
format = "text"
delimiter = "|"
decimal = ","
encoding = "utf-16"
header = 2
missing = [-999, "ERR"]
"""
    path = small_problem.write(tmp_path, small_problem.changed('"spring.csv"', '"s.mat"' + keys))
    rows = "0,0|1,5|ERR\n0,1|1,5|-999\n0,2|1,5|2,5\n"
    (tmp_path / "s.mat").write_text("by hand\nt|force|place\n" + rows, encoding="utf-16")
    recording = recording_of(load(path))
    np.testing.assert_array_equal(recording.y[:, 0], [np.nan, np.nan, 2.5])
    np.testing.assert_array_equal(recording.u[:, 0], [1.5, 1.5, 1.5])
    for wrong in ('decimal = "x"', "axis = 2", "missing = 3", "header = -1"):
        text = small_problem.changed("[model]", wrong + "\n[model]")
        path = small_problem.write(tmp_path, text)
        with pytest.raises(ProblemError, match=rf"recording\.{wrong.split()[0]}"):
            load(path)


def test_every_estimator_is_compiled_once(tmp_path, monkeypatch):
    compiled = []
    for kind in (EKF, MHO):
        trace = kind.build

        def counted(self, model, dt, trace=trace):
            compiled.append(self.key)
            return trace(self, model, dt)

        monkeypatch.setattr(kind, "build", counted)
    monkeypatch.setattr("backsight.run.compare.audited", lambda results, *_: results)
    run_problem(load(small_problem.write(tmp_path)), tmp_path / "out", progress=lambda *_: None)
    assert compiled == ["ekf", "mho"]
