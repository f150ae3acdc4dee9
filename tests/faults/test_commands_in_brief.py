"""Commands on a disk that is full at once: a line, and the folder as it was."""

import errno

import pytest
from tests.faults.test_commands_on_a_bad_disk import STUDY
from tests.fleet.springs import write_fleet
from typer.testing import CliRunner

import small_problem
from backsight.cli import app


def study(folder, monkeypatch):
    (folder / "version").write_text("New")
    names = {"__file__": str(folder / "study.py")}
    exec(STUDY, names)
    monkeypatch.setattr("backsight.studies.studies", lambda **_: {"springs": names["STUDY"]})
    return ["study", "run", "springs", "-o", folder / "out"]


def fleet(folder, monkeypatch):
    return ["fleet", write_fleet(folder), "-o", folder / "out", "--workers", 0]


def live(folder, monkeypatch):
    only = small_problem.TEXT.partition("[estimators.MHO]")[0]
    more = '[live]\n[source.rig]\nkind = "replay"\nspeed = 0\n[store]\npath = "out"\n'
    monkeypatch.setattr("backsight.live.running.can_revive", lambda: False)
    return ["live", small_problem.write(folder, only + more)]


@pytest.mark.parametrize("prepared", [study, fleet, live])
def test_a_disk_that_is_full_at_once_is_said_in_a_line(prepared, tmp_path, monkeypatch):
    words = prepared(tmp_path, monkeypatch)
    (tmp_path / "out").mkdir()

    def full(_number):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    monkeypatch.setattr("backsight.engine._cache.keep", lambda *_: None)
    done = CliRunner().invoke(app, list(map(str, words)))
    assert done.exit_code == 2, done.output
    assert done.stderr.count("\n") == 1
    assert "No space left on device" in done.stderr
    # What a fleet goes on from is there from its first moment on.
    assert {p.name for p in (tmp_path / "out").iterdir()} <= {".lock", "fleet.sqlite"}
