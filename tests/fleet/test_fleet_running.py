"""Fleets in one process: rows against single runs, and what goes on after an end."""

import os
import sqlite3

import numpy as np
import pytest
import xarray as xr
from tests.fleet.springs import FLEET, PROBLEM, write_fleet, write_recording

import backsight as bs
from backsight.errors import OutputError
from backsight.fleet import load_fleet, problem_of_item, read_rows, run_fleet
from backsight.fleet.rows.store import ROWS
from backsight.output import holding
from backsight.problem import load
from backsight.problem.recorded import recording_of


def run(path, out, **given):
    return run_fleet(load_fleet(path), out, workers=0, **given)


def kept(out):
    """All that a store says, as text: equal texts are equal to the last bit."""
    with sqlite3.connect(out / ROWS) as file:
        return dict(file.execute("SELECT item || estimator, row FROM rows"))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    path = write_fleet(folder, more="sweep.model.k = [38.0, 40.0]\n")
    assert run(path, folder / "store").items == 6
    return folder


def test_rows_are_those_of_single_runs(fleet):
    rows = read_rows(fleet / "store")
    assert rows["recording"].tolist() == [f"runs/r{k}.csv" for k in (0, 0, 1, 1, 2, 2)]
    assert rows["model.k"].tolist() == [38.0, 40.0] * 3
    (fleet / "one.toml").write_text(
        PROBLEM.replace("none.csv", "runs/r1.csv").replace("k = 40.0", "k = 38.0"), "utf-8"
    )
    problem = load(fleet / "one.toml")
    result = bs.estimate(problem.estimators["KF"], problem.model, recording_of(problem))
    row = rows.iloc[2]
    last = result.isel(time=-1)
    assert [row["q"], row["v"]] == pytest.approx(last.x_hat.values.tolist(), rel=1e-9)
    assert [row["q_std"], row["v_std"]] == pytest.approx(last.x_std.values.tolist(), rel=1e-9)
    expected = bs.check.mean_nis(result)  # one output
    assert row["nis_ratio"] == pytest.approx(expected, rel=1e-9)
    assert row["log_likelihood"] == pytest.approx(
        float(bs.check.log_likelihood(result).mean()), rel=1e-9
    )
    assert row["samples"] == 40


def test_a_row_does_not_depend_on_what_is_beside_it(fleet, tmp_path):
    """Other recordings in the lanes, and a recording alone: the same to the last bit."""
    alone = write_fleet(tmp_path, count=2, more="sweep.model.k = [38.0, 40.0]\n")
    (tmp_path / "runs" / "r0.csv").unlink()
    run(alone, tmp_path / "store")
    assert len(kept(tmp_path / "store")) == 2
    assert kept(tmp_path / "store").items() <= kept(fleet / "store").items()


def test_what_is_there_is_not_done_again(fleet):
    before = kept(fleet / "store")
    done = run(fleet / "fleet.toml", fleet / "store")
    assert (done.items, done.before) == (6, 6)
    assert kept(fleet / "store") == before


def test_a_touched_recording_stays_and_a_changed_one_is_done_again(tmp_path):
    path, out = write_fleet(tmp_path), tmp_path / "store"
    run(path, out)
    before = kept(out)
    os.utime(tmp_path / "runs" / "r0.csv", ns=(1, 1))
    assert run(path, out).before == 2  # it is looked at again
    assert kept(out) == before
    assert run(path, out).before == 3
    write_recording(tmp_path / "runs" / "r1.csv", 99)
    run(path, out)
    changed = {key for key, row in kept(out).items() if row != before[key]}
    assert len(changed) == 1


def test_more_recordings_and_values_are_added_and_others_leave_the_table(tmp_path):
    path, out = write_fleet(tmp_path, more="sweep.model.k = [40.0]\n"), tmp_path / "store"
    run(path, out)
    write_recording(tmp_path / "runs" / "r3.csv", 3)
    (tmp_path / "runs" / "r0.csv").unlink()
    path.write_text(FLEET + "sweep.model.k = [40.0, 41.0]\n", encoding="utf-8")
    done = run(path, out)
    assert (done.items, done.before) == (6, 2)
    assert set(read_rows(out)["recording"]) == {"runs/r1.csv", "runs/r2.csv", "runs/r3.csv"}


def test_a_recording_that_fails_is_a_row_with_its_reason(tmp_path):
    path, out = write_fleet(tmp_path), tmp_path / "store"
    (tmp_path / "runs" / "r1.csv").write_text("t,force\n0,1\n", encoding="utf-8")
    lost = "\n".join([line.rpartition(",")[0] + ",1e200" for line in
                      (tmp_path / "runs" / "r2.csv").read_text().splitlines()[1:]])  # fmt: skip
    (tmp_path / "runs" / "r2.csv").write_text(f"t,force,place\n{lost}\n", encoding="utf-8")
    run(path, out)
    rows = read_rows(out).set_index("recording")
    assert rows.loc["runs/r0.csv", "failure"] == ""
    assert "no column 'place'" in rows.loc["runs/r1.csv", "failure"]
    assert rows.loc["runs/r2.csv", "failure"] != ""
    assert rows.loc["runs/r1.csv", "outlying"] == np.inf
    assert run(path, out).before == 3  # the same data would fail again


def test_a_file_that_is_not_there_is_tried_again(tmp_path):
    text = 'problem = "spring.toml"\nrecordings.table = "runs.csv"\n'
    path, out = write_fleet(tmp_path, count=1, fleet=text), tmp_path / "store"
    (tmp_path / "runs.csv").write_text("file\nruns/r0.csv\nruns/r1.csv\n", encoding="utf-8")
    run(path, out)
    assert "cannot be read" in read_rows(out)["failure"][1]
    write_recording(tmp_path / "runs" / "r1.csv", 1)
    assert run(path, out).before == 1
    assert read_rows(out)["failure"].tolist() == ["", ""]


def test_a_recording_that_changes_while_it_is_read(tmp_path, monkeypatch):
    from backsight.fleet.items import _reading

    path, out = write_fleet(tmp_path, count=2), tmp_path / "store"
    read = _reading.recording_of

    def growing(problem, **given):
        with open(problem.recording.path, "a", encoding="utf-8") as file:
            file.write("2.0,0.0,0.0\n")
        return read(problem, **given)

    with monkeypatch.context() as patch:
        patch.setattr(_reading, "recording_of", growing)
        run(path, out)
    assert read_rows(out)["failure"].str.contains("changes while it is read").all()
    assert run(path, out).before == 0


def test_several_periods_are_grouped_and_rounding_of_times_is_not(tmp_path):
    path, out = write_fleet(tmp_path, count=0, fleet=FLEET), tmp_path / "store"
    for k, dt in enumerate((0.05, 0.02, 0.05 * (1 + 1e-13))):
        write_recording(tmp_path / "runs" / f"r{k}.csv", k, dt=dt)
    run(path, out)
    assert read_rows(out)["dt"].tolist() == [0.05, 0.02, 0.05]


def test_results_are_kept_as_far_as_they_are_asked_for(tmp_path):
    keep = '[keep]\nvariables = ["x_std"]\nevery = 4\ndtype = "float32"\n'
    path, out = write_fleet(tmp_path, count=1, more=keep), tmp_path / "store"
    run(path, out)
    item = read_rows(out)["item"][0]
    result = xr.load_dataset(out / "results" / f"{item}.nc", group="KF", engine="h5netcdf")
    assert result.sizes["time"] == 10
    assert result.x_std.dtype == np.float32


def test_a_row_leads_to_its_problem(fleet):
    row = read_rows(fleet / "store").iloc[2]
    problem = problem_of_item(fleet / "store", row["item"])
    assert problem.recording.path.endswith("runs/r1.csv")
    assert "# with model.k = 38.0" in problem.text


def test_outliers_are_those_that_are_off_the_others(tmp_path):
    path, out = write_fleet(tmp_path, count=6), tmp_path / "store"
    lines = (tmp_path / "runs" / "r3.csv").read_text().splitlines()
    noisy = [f"{','.join(line.split(',')[:2])},{0.1 * (-1) ** k}" for k, line in
             enumerate(lines[1:])]  # fmt: skip
    (tmp_path / "runs" / "r3.csv").write_text("\n".join([lines[0], *noisy]), encoding="utf-8")
    run(path, out)
    rows = read_rows(out)
    assert rows["outlying"].idxmax() == 3
    assert rows["outlying"][3] > 5


def test_stores_of_others_are_refused(fleet, tmp_path):
    other = write_fleet(tmp_path, more="sweep.model.b = [1.0]\n")
    with pytest.raises(OutputError, match="another fleet"):
        run(other, fleet / "store")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("all of it", encoding="utf-8")
    with pytest.raises(OutputError, match=r"not from here, such as thesis\.tex"):
        run(other, tmp_path / "mine")
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / ROWS).write_text("no database, but longer than its header" * 9, "utf-8")
    with pytest.raises(OutputError, match="not from here"):
        run(other, tmp_path / "text")


def test_two_drivers_on_one_store(fleet):
    with holding(fleet / "store"), pytest.raises(OutputError, match="another process writes"):
        run(fleet / "fleet.toml", fleet / "store")


def test_another_version_is_refused(fleet, monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", lambda name: "9.9.9")
    with pytest.raises(OutputError, match=r"begun with version .*, this is 9\.9\.9"):
        run(fleet / "fleet.toml", fleet / "store")


def test_a_full_disk_says_what_is_missing_and_goes_on_later(tmp_path, monkeypatch):
    from backsight.fleet.rows import store

    path, out = write_fleet(tmp_path), tmp_path / "store"
    connected = store._connected

    def small(folder):
        connection = connected(folder)
        connection.execute("PRAGMA max_page_count = 24")
        return connection

    for k in range(3, 240):
        (tmp_path / "runs" / f"r{k}.csv").write_text("t,force\n0,1\n", encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setattr(store, "_connected", small)
        with pytest.raises(OutputError, match=r"disk is full; \d+ .* are missing"):
            run(path, out)
    done = run(path, out)
    assert 0 < done.before < done.items == 240
    assert len(read_rows(out)) == 240
