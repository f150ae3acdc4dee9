"""What a fleet file may say, and what is refused before anything runs."""

import pytest
from tests.fleet.springs import FLEET, PROBLEM, write_fleet

from backsight.errors import ProblemError
from backsight.fleet import load_fleet


def test_every_combination_of_lists_and_ranges(tmp_path):
    sweep = (
        "[sweep]\nmodel.k = { from = 30, to = 50, step = 10 }\n"
        '"noise.sigma_y.y" = { from = 1e-4, to = 1e-2, count = 3, scale = "log" }\n'
    )
    fleet = load_fleet(write_fleet(tmp_path, more=sweep))
    assert fleet.axes["model.k"] == (30, 40, 50)
    assert fleet.axes["noise.sigma_y.y"] == pytest.approx((1e-4, 1e-3, 1e-2))
    assert len(fleet.settings) == 9
    assert len(set(fleet.settings)) == 9


def test_a_table_brings_settings_and_what_is_known(tmp_path):
    text = 'problem = "spring.toml"\n[recordings]\ntable = "runs.csv"\nsettings."model.k" = "k"\n'
    path = write_fleet(tmp_path, fleet=text)
    table = "file;k;rig;day\nruns/r0.csv;30.0;A;2026-01-02\nruns/r1.csv;;B;2026-01-03\n"
    (tmp_path / "runs.csv").write_text(table, encoding="utf-8")
    first, second = load_fleet(path).recordings
    assert first.changes == (("model.k", 30.0),)
    assert second.changes == ()
    assert (first.name, first.metadata) == ("runs/r0.csv", {"rig": "A", "day": "2026-01-02"})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("sweep.model.k = 3\n", "sweep.model.k: give a list"),
        ("sweep.model.k = []\n", "sweep.model.k: is empty"),
        ("sweep.model.k = { from = 1, to = 2 }\n", "the step or the count"),
        ("sweep.model.k = { from = 1, to = 2, stop = 3 }\n", "sweep.model.k.stop: unknown key"),
        ("sweep.model.kk = [1.0]\n", "with model.kk = 1.0: model.kk: unknown key"),
        ("sweep.noise.sigma_y.y = [1e-3, -1.0]\n", "with noise.sigma_y.y = -1.0"),
        ("sweep.recording.path = ['a']\n", "said by [recordings]"),
        ("sweep.estimators.KF.kind.of = [1]\n", "estimators.KF.kind is no table"),
        ("keep.variables = ['x_hat', 'x_hat']\n", "keep: "),
        ("recordings.table = 'runs.csv'\n", "give files (a pattern) or a table"),
    ],
)
def test_a_wrong_file_is_named_by_its_key(tmp_path, more, said):
    with pytest.raises(ProblemError) as caught:
        load_fleet(write_fleet(tmp_path, more=more))
    assert said in str(caught.value)


def test_a_table_without_its_column_or_with_a_recording_twice(tmp_path):
    text = 'problem = "spring.toml"\nrecordings.table = "runs.csv"\n'
    path = write_fleet(tmp_path, fleet=text)
    (tmp_path / "runs.csv").write_text("files,rig\nruns/r0.csv,A\n", encoding="utf-8")
    with pytest.raises(ProblemError, match="no column 'file', did you mean 'files'"):
        load_fleet(path)
    twice = "file,rig\nruns/r0.csv,A\nruns/r0.csv,B\n"
    (tmp_path / "runs.csv").write_text(twice, encoding="utf-8")
    with pytest.raises(ProblemError, match="once more"):
        load_fleet(path)


def test_no_recordings_and_a_wrong_problem(tmp_path):
    path = write_fleet(tmp_path, count=0)
    with pytest.raises(ProblemError, match="there is no file"):
        load_fleet(path)
    write_fleet(tmp_path)
    (tmp_path / "spring.toml").write_text(PROBLEM.replace("kf", "kff"), encoding="utf-8")
    with pytest.raises(ProblemError, match=r"estimators.KF.kind: unknown kind 'kff'"):
        load_fleet(path)


def test_what_makes_another_fleet(tmp_path):
    path = write_fleet(tmp_path, more="sweep.model.k = [30.0]\n")
    said = load_fleet(path).identity()
    path.write_text(FLEET + "sweep.model.k = [30.0, 31.0]\n", encoding="utf-8")
    assert load_fleet(path).identity() == said
    path.write_text(FLEET + "sweep.model.b = [1.0]\n", encoding="utf-8")
    assert load_fleet(path).identity() != said
    path.write_text(FLEET + "sweep.model.k = [30.0]\n", encoding="utf-8")
    (tmp_path / "spring.toml").write_text(PROBLEM.replace("1e-3", "2e-3"), encoding="utf-8")
    assert load_fleet(path).identity() != said
