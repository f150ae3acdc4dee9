"""What the commands print, and that they come at once."""

import os
import subprocess
import sys

import backsight as bs
import small_problem
from backsight.description import meanings_of
from backsight.output import MARKER
from backsight.problem.reading.settings import fields_of
from backsight_studies import STUDIES
from backsight_studies.study import Study, Written


def test_version(backsight):
    code, printed, _ = backsight("--version")
    assert (code, printed.strip()) == (0, bs.__version__)


def test_help_names_the_commands(backsight):
    code, printed, _ = backsight("--help")
    assert code == 0
    for command in ("run", "methods", "study"):
        assert f" {command} " in printed


def test_methods_are_those_of_the_table(backsight):
    code, printed, _ = backsight("methods")
    assert code == 0
    assert [line for line in printed.splitlines() if line.startswith("kind = ")] == [
        f'kind = "{key}"' for key in sorted(bs.extend.ESTIMATORS)
    ]


def test_run_prints_ranking_values_and_place(backsight, tmp_path):
    out = tmp_path / "out"
    code, printed, told = backsight("run", small_problem.write(tmp_path), "-o", out)
    assert (code, told) == (0, "")
    lines = printed.splitlines()
    assert lines[0] == "Mass on a spring"
    assert max(map(len, lines[:-1])) <= 80
    assert any(line.startswith(" 1   ") for line in lines)
    assert any(line.startswith(" k [1/s2] ") and "100" in line for line in lines)
    assert lines[-1] == f"Report: {out / 'report.html'}"


def run_apart(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "backsight", *map(str, arguments)],
        capture_output=True,
        env={**os.environ, **environment},
        timeout=60,
        check=False,
    )


def test_a_pipe_with_few_characters_gets_all_lines_and_no_progress(tmp_path):
    done = run_apart(
        "run", small_problem.write(tmp_path), "-o", tmp_path / "out", PYTHONIOENCODING="cp1252"
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"100.0" in done.stdout
    assert b"\x1b" not in done.stdout


def test_an_interrupt_leaves_nothing(backsight, tmp_path, monkeypatch):
    path = small_problem.write(tmp_path)
    before = sorted(tmp_path.iterdir())

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("backsight.problem.running.report", interrupted)
    code, printed, told = backsight("run", path, "-o", tmp_path / "out")
    assert (code, printed) == (130, "")
    assert told == "backsight: interrupted, nothing is written\n"
    assert sorted(tmp_path.iterdir()) == before


HEAVY = {"plotly", "matplotlib", "typer", "pydantic"}


def test_importing_the_package_is_light():
    code = "import sys, backsight; print(*{m.split('.')[0] for m in sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert not HEAVY & set(done.stdout.split())


def test_studies_are_those_of_the_table(backsight):
    code, printed, _ = backsight("study", "list")
    assert code == 0
    assert printed.splitlines() == [f"{name}: {s.title}" for name, s in STUDIES.items()]


def test_a_study_is_run_with_its_seeds_and_recordings(backsight, tmp_path, monkeypatch):
    asked = {}

    def carry_out(seeds, recordings, progress):
        progress("at work", 0.5)
        asked.update(seeds=list(seeds), recordings=list(recordings))
        return "all is well"

    def write(experiment, folder):
        (folder / "table.csv").write_text("1\n")
        return Written(checks=(), page="<p>", points=[experiment])

    monkeypatch.setitem(STUDIES, "own", Study("own", "Own", carry_out, write, seeds=4))
    extra = tmp_path / "more.csv"
    code, printed, _ = backsight(
        "study", "run", "own", "-o", tmp_path, "--seeds", 3, "--recording", extra
    )
    assert code == 0
    assert asked == {"seeds": [0, 1, 2], "recordings": [extra]}
    assert "all is well" in printed
    assert f"Page: {tmp_path / 'study.html'}" in printed
    assert {p.name for p in tmp_path.iterdir()} == {
        "study.html",
        "checks.json",
        "table.csv",
        MARKER,
    }
    assert backsight("study", "run", "own", "-o", tmp_path)[0] == 0
    assert asked["seeds"] == [0, 1, 2, 3]


def test_an_unknown_study_is_refused(backsight, tmp_path):
    code, _, told = backsight("study", "run", "nanopositoner", "-o", tmp_path)
    assert code == 2
    assert "there is no study 'nanopositoner', did you mean 'nanopositioner'?" in told


def test_export_makes_a_name_in_c_of_the_estimators(backsight, tmp_path):
    path = small_problem.write(tmp_path)
    text = path.read_text(encoding="utf-8").replace("[estimators.EKF]", '[estimators."my EKF-b"]')
    path.write_text(text, encoding="utf-8")
    code, _, told = backsight("export", path, "-e", "my EKF-b", "-o", tmp_path / "c")
    assert (code, told) == (0, "")
    assert (tmp_path / "c" / "my_ekf_b.h").exists()


def test_check_tells_the_integration_step_and_whether_it_is_too_coarse(backsight, tmp_path):
    path = small_problem.write(tmp_path)
    code, printed, _ = backsight("check", path)
    assert code == 0
    assert "EKF: rk4, 1 per sample, inputs held" in printed
    poor = "[integrator]\nscheme = 'euler'\nsubsteps = 1\n[prior]"
    small_problem.write(tmp_path, small_problem.TEXT.replace("[prior]", poor))
    code, printed, _ = backsight("check", path)
    assert code == 1
    said = " ".join(printed.split())
    assert "EKF: the integration step, euler with 1 step per sample of 0.01 s, is unstable" in said
    _, printed, told = backsight("run", path, "--out", tmp_path / "out")
    assert "MHO: the integration step, euler" in " ".join(told.split())
    assert "MHO: the integration step, euler" in " ".join(printed.split())


def test_every_setting_of_a_kind_is_explained(backsight):
    for key, kind in bs.extend.ESTIMATORS.items():
        code, printed, _ = backsight("methods", key)
        assert code == 0
        assert f'kind = "{key}"' in printed
        meanings = meanings_of(kind)
        for field in fields_of(kind):
            assert field.name in meanings, f"{kind.__name__} does not say what {field.name} is"
            if field.name not in ("noise", "prior"):
                assert f"{field.name} = " in printed
    assert backsight("methods", "MHE") == backsight("methods", "mhe")
    code, _, told = backsight("methods", "efk")
    assert code == 2
    assert "did you mean 'ekf'" in told


def test_help_is_whole(backsight):
    assert "[from the estimator's name]" in backsight("export", "-h")[1]
