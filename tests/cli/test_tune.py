"""The command that tunes a problem file: what it writes, keeps, and refuses."""

import tomllib

import numpy as np
import pytest
import scipy

import backsight as bs
import small_problem
from backsight.problem import load
from backsight.problem._writing import written
from backsight.problem.recorded import recording_of

GUESSED = small_problem.TEXT.replace(
    "sigma_y = { y = 1e-4 }",
    "sigma_y = { y = 1e-3 }   # a guess\nsigma_w = { v = 1e-3 }",
)


def problem(folder, text):
    small_problem.write(folder)
    path = folder / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_writes_the_same_file_with_other_values(backsight, tmp_path):
    path = problem(tmp_path, "# mine\n" + GUESSED + '\n[tune]\nfree = ["sigma_y", "c"]\n')
    out = tmp_path / "tuned.toml"
    code, printed, told = backsight("tune", path, "--out", out)
    assert (code, told) == (0, "")
    assert "sigma_y.y" in printed
    before, after = (p.read_text(encoding="utf-8").splitlines() for p in (path, out))
    changed = [line for line in before if line not in after]
    assert len(changed) == 2
    assert any(line.startswith("sigma_y") and line.endswith("# a guess") for line in after)
    found = tomllib.loads(out.read_text(encoding="utf-8"))
    assert found["noise"]["sigma_y"]["y"] == pytest.approx(1e-4, rel=0.15)
    assert found["tune"]["found"]["c"]["value"] == found["model"]["c"]
    assert found["tune"]["found"]["sigma_y.y"]["before"] == 1e-3
    # It is a problem file like any other: it runs, and can be tuned again in its place.
    assert load(out).estimators["EKF"].noise.sigma_y == found["noise"]["sigma_y"]
    assert backsight("tune", out, "--out", out, "--force")[0] == 0


def test_what_unknowns_say_of_themselves_is_changed_there(backsight, tmp_path):
    text = GUESSED.replace("sigma = 30.0 }", "sigma = 30.0, walk = 0.1 }")
    free = '\n[tune]\nfree = ["sigma_y", "sigma_w.k", "sigma_x0.b", "x0.b"]\nestimator = "MHO"\n'
    path, out = problem(tmp_path, text + free), tmp_path / "other" / "tuned.toml"
    code, printed, _ = backsight("tune", path, "--out", out, "--page", tmp_path / "page.html")
    assert code in (0, 1)
    assert "Tuned by: Extended Kalman filter, with noise and prior of Moving" in printed
    found = tomllib.loads(out.read_text(encoding="utf-8"))
    assert found["estimate"]["k"]["walk"] != 0.1
    assert found["estimate"]["b"]["start"] != 1.0
    assert "x0" not in found["prior"]
    assert found["recording"]["path"] == "../spring.csv"
    assert bs.read(out.parent / found["recording"]["path"], time="t", inputs={"u": "force"},
                   outputs={"y": "place"}).sizes["time"] == 200  # fmt: skip
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "before and after tuning" in page
    drawn = page.split('id="tuning"')[1]
    assert drawn.count("<polyline") == 4
    assert 'aria-label="rise of the criterion over sigma_w.k"' in drawn


def test_whole_covariances_and_delays_go_into_the_file(backsight, tmp_path):
    free = '[{ name = "Q", structure = ["", "a", "", ""] }, { name = "delay.y", sigma = 0.01 }]'
    path, out = problem(tmp_path, GUESSED + f"\n[tune]\nfree = {free}\n"), tmp_path / "tuned.toml"
    code, printed, _ = backsight("tune", path, "--out", out, "--estimator", "EKF")
    assert code in (0, 1)
    assert "Q.v " in printed
    found = tomllib.loads(out.read_text(encoding="utf-8"))
    assert "sigma_w" not in found["noise"]
    assert found["noise"]["Q"][1][1] == found["tune"]["found"]["Q.v"]["value"]
    late = found["tune"]["found"]["delay.y"]["value"]
    assert found["recording"]["inputs"]["u"]["delay"] == -late
    assert load(out).recording.inputs["u"].delay == -late


def test_says_what_could_not_be_found(backsight, tmp_path):
    path = problem(tmp_path, GUESSED)
    code, printed, _ = backsight("tune", path, "--out", tmp_path / "tuned.toml")
    assert code == 1  # the motion has no process noise
    assert "! sigma_w.v is hardly known" in printed


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('free = ["sigma_z"]', "tune: 'sigma_z' cannot be free"),
        ('free = [{ name = "c", spread = 0.5 }]', "spread is 0.5; it must be above 1"),
        ('free = ["sigma_y"]\ncriterion = { kind = "Best" }', "tune.criterion.kind: unknown kind"),
        ('free = ["sigma_y"]\nestimator = "UKF"', "tune.estimator: there is no 'UKF'"),
        ('free = ["sigma_y"]\nrecordings = ["none.csv"]', "there is no file"),
        ("free = [1]", "tune.free"),
        ('free = [{ name = "lag", options = [1, 2] }]', "there is no setting 'lag'"),
    ],
)
def test_refuses_in_one_line_and_writes_nothing(backsight, tmp_path, table, message):
    path = problem(tmp_path, f"{GUESSED}\n[tune]\n{table}\n")
    code, printed, told = backsight("tune", path, "--out", tmp_path / "tuned.toml")
    assert (code, printed, told.count("\n")) == (2, "", 1)
    assert message in told
    assert not (tmp_path / "tuned.toml").exists()


SEVERAL = (
    GUESSED.replace('inputs.u = { column = "force", unit = "N" }\n', "")
    + """
[recording.sources.force]
path = "spring.csv"
time = "t"
inputs.u = { column = "force", unit = "N" }

[tune]
free = ["sigma_y"]
"""
)


def test_all_files_of_a_recording_are_found_from_elsewhere(backsight, tmp_path):
    path, out = problem(tmp_path, SEVERAL), tmp_path / "other" / "tuned.toml"
    assert backsight("tune", path, "--out", out)[0] == 0
    sources = tomllib.loads(out.read_text(encoding="utf-8"))["recording"]["sources"]
    assert sources["force"]["path"] == "../spring.csv"
    path.write_text(SEVERAL + 'recordings = ["spring.csv"]\n', encoding="utf-8")
    code, _, told = backsight("tune", path, "--out", tmp_path / "again.toml")
    assert code == 2
    assert "tune.recordings: a recording of several files" in told


def test_replaces_no_file_unless_told_to(backsight, tmp_path):
    path = problem(tmp_path, GUESSED)
    code, _, told = backsight("tune", path, "--out", path)
    assert code == 2
    assert "--force" in told
    assert path.read_text(encoding="utf-8") == GUESSED


OPTIONS = """
[estimators.window]
kind = "mhe"
N = 4
arrival = { kind = "NoArrival" }

[tune]
estimator = "window"
free = [{ name = "arrival", options = [{ kind = "NoArrival" }, { kind = "EKFArrival" }] }]
"""


def test_options_may_be_tables(backsight, tmp_path):
    path, out = problem(tmp_path, GUESSED + OPTIONS), tmp_path / "tuned.toml"
    code, printed, _ = backsight("tune", path, "--out", out)
    assert code == 0
    assert "arrival = EKFArrival" in printed
    found = tomllib.loads(out.read_text(encoding="utf-8"))
    assert found["estimators"]["window"]["arrival"] == {"kind": "EKFArrival"}
    assert load(out).estimators["window"].arrival == bs.settings.EKFArrival()


def test_settings_of_several_numbers_go_into_the_file(backsight, tmp_path):
    observer = """
[estimators.observer]
kind = "ahg"
gain = 20.0
Gamma = [1e3, 10.0]

[tune]
estimator = "observer"
free = ["Gamma"]
"""
    path, out = problem(tmp_path, GUESSED + observer), tmp_path / "tuned.toml"
    assert backsight("tune", path, "--out", out)[0] in (0, 1)
    found = tomllib.loads(out.read_text(encoding="utf-8"))
    factor = found["tune"]["found"]["Gamma"]["value"]
    assert factor != 1
    Gamma = found["estimators"]["observer"]["Gamma"]
    assert Gamma == pytest.approx([1e3 * factor, 10 * factor], rel=1e-4)
    assert load(out).estimators["observer"].Gamma.tolist() == Gamma


WIND = """\
[recording]
path = "pole.csv"
dt = 0.05
inputs = {}
outputs.y = { column = "y", unit = "m" }

[model]
kind = "modal"
frequencies = [1.5]
damping = 0.03
sensors = { y = { kind = "displacement", at = [1.0] } }
forces = { wind = [1.0] }

[forces.wind]
kind = "KIND"
sigma = 1.0      # a guess
TIME = 3.0

[noise]
sigma_y = { y = 1e-3 }

[prior]
sigma_x0 = { q1 = 0.1, q1_dot = 1.0 }

[estimators.kf]
kind = "kf"

[tune]
free = FREE
"""


def blown(tmp_path, kind, time, free):
    """A problem file and its recording: a pole in a wind that forgets after 0.8 s."""
    rng, x = np.random.default_rng(0), np.zeros(3)
    Phi = scipy.linalg.expm(0.05 * np.array([[0, 1, 0], [-90, -0.6, 1], [0, 0, -1.2]]))
    rows = []
    for _ in range(100):
        rows.append(x[0] + 1e-3 * rng.standard_normal())
        x = Phi @ x + [0, 0, rng.standard_normal()]
    np.savetxt(tmp_path / "pole.csv", rows, header="y", comments="")
    text = WIND.replace("KIND", kind).replace("TIME", time).replace("FREE", free)
    path = tmp_path / "problem.toml"
    path.write_text(text, encoding="utf-8")
    return path


def check_process(new, time, out):
    """What the new text says of the process is what was found, and is read again as this."""
    assert "# a guess" in new
    document = tomllib.loads(new)
    found, wind = document["tune"]["found"], document["forces"]["wind"]
    assert wind["sigma"] == found["wind.sigma"]["value"] != 1.0
    assert wind[time] == (found["wind.length"]["value"] if "wind.length" in found else 3.0)
    assert set(wind) == {"kind", "sigma", time}
    assert load(out).model.driven[0].process.sigma == wind["sigma"]
    return wind


KINDS = [("gauss_markov", "time", ["wind"]), ("matern", "length", ["wind.sigma", "wind.length"])]


@pytest.mark.parametrize(("kind", "time", "free"), KINDS)
def test_processes_of_forces_have_their_place_in_the_file(tmp_path, kind, time, free):
    problem = load(blown(tmp_path, kind, time, "[]"))
    recording = recording_of(problem).isel(time=slice(0, 20))
    given = problem.estimators["kf"], problem.model, recording
    tuned = bs.tune.fit(*given, free=free, passes=3, check=False, restarts=0)
    text, out = written(problem, "kf", tuned, folder=tmp_path), tmp_path / "tuned.toml"
    out.write_text(text, encoding="utf-8")
    check_process(text, time, out)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "time", "free"), [*KINDS, ("gauss_markov", "time", ["wind.sigma"])]
)
def test_processes_of_forces_are_tuned_by_the_command(backsight, tmp_path, kind, time, free):
    path, out = blown(tmp_path, kind, time, str(free)), tmp_path / "tuned.toml"
    code, printed, told = backsight("tune", path, "--out", out)
    assert (code in (0, 1), told) == (True, "")
    assert "wind.sigma" in printed
    wind = check_process(out.read_text(encoding="utf-8"), time, out)
    # Another tuning of the new file has nothing left to do.
    assert backsight("tune", out, "--out", out, "--force")[0] in (0, 1)
    again = tomllib.loads(out.read_text(encoding="utf-8"))["forces"]["wind"]
    assert again["sigma"] == pytest.approx(wind["sigma"], rel=0.05)
