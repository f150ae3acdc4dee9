"""What a problem file's recording can show: the verdict, the command, the warning of a run."""

import pytest
from typer.testing import CliRunner

import small_problem
from backsight.cli import app
from backsight.problem import load
from backsight.problem.recorded import recording_of
from backsight.problem.seeing import doubts, examine


def command(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def without_force(tmp_path):
    """The same machine at rest: its force column is zero."""
    path = small_problem.write(tmp_path)
    rows = [f"{t!r},0.0,{y!r}" for t, _, y in small_problem.table().tolist()]
    text = "\n".join(["t,force,place", *rows]) + "\n"
    (tmp_path / "spring.csv").write_text(text, encoding="utf-8")
    return path


def test_moving_machine_shows_everything(tmp_path):
    problem = load(small_problem.write(tmp_path))
    data = recording_of(problem)
    assert examine(problem, data).observable
    assert doubts(problem, data) == []


def test_machine_at_rest_hides_its_parameters(tmp_path):
    problem = load(without_force(tmp_path))
    data = recording_of(problem)
    assert examine(problem, data).hidden == ("k", "b")
    assert any("cannot be seen: k" in sentence for sentence in doubts(problem, data))


@pytest.mark.parametrize(("moving", "code"), [(True, 0), (False, 1)])
def test_check_prints_the_verdict(tmp_path, moving, code):
    path = small_problem.write(tmp_path) if moving else without_force(tmp_path)
    found, printed, told = command("check", path)
    assert found == code
    assert told == ""
    assert "Mass on a spring" in printed
    assert (": observable over 200 samples" in printed) == moving
    assert ("cannot be seen: k" in printed) == (not moving)


def test_run_warns_before_it_starts(tmp_path):
    code, _, told = command("run", without_force(tmp_path), "--out", tmp_path / "out")
    assert code == 0
    assert "warning: sdof: not observable over 200 samples" in told
    _, _, told = command("run", small_problem.write(tmp_path), "--out", tmp_path / "out")
    assert told == ""


def test_check_refuses_a_wrong_file(tmp_path):
    code, printed, told = command("check", tmp_path / "none.toml")
    assert code == 2
    assert printed == ""
    assert told.startswith("backsight: there is no file")
