"""Everything that can be wrong gets one clear line, exit code 2, and nothing half written."""

import types

import numpy as np
import psutil
import pytest

import small_problem

changed = small_problem.changed


def cells() -> list[list[str]]:
    return [list(map(repr, row)) for row in small_problem.table().tolist()]


def write_recording(tmp_path, rows):
    text = "\n".join(["t,force,place", *(",".join(row) for row in rows)]) + "\n"
    (tmp_path / "spring.csv").write_text(text, encoding="utf-8")


# the recording


def test_missing_problem_file(backsight, tmp_path):
    small_problem.write(tmp_path)
    code, _, told = backsight("run", tmp_path / "poblem.toml", "--out", tmp_path / "out")
    assert code == 2
    assert told.count("\n") == 1
    assert "there is no file" in told
    assert "did you mean 'problem.toml'?" in told


def test_missing_recording(refused):
    told = refused(changed('"spring.csv"', '"sprint.csv"'))
    assert "sprint.csv" in told
    assert "did you mean 'spring.csv'?" in told


def test_missing_recording_says_where_to_get_it(refused, monkeypatch):
    monkeypatch.delenv("BACKSIGHT_DATA", raising=False)
    source = 'source = "the library of springs"'
    told = refused(changed('path = "spring.csv"', f'path = "${{BACKSIGHT_DATA}}/s.csv"\n{source}'))
    assert "recording.path: the environment variable BACKSIGHT_DATA is not set" in told
    assert "the library of springs" in told
    told = refused(changed('path = "spring.csv"', f'path = "s.csv"\n{source}'))
    assert "s.csv" in told
    assert "the library of springs" in told


@pytest.mark.parametrize("value", ["/somewhere", None])
def test_a_file_cannot_ask_what_the_environment_holds(refused, monkeypatch, value):
    if value is None:
        monkeypatch.delenv("MY_TOKEN", raising=False)
    else:
        monkeypatch.setenv("MY_TOKEN", value)
    told = refused(changed('path = "spring.csv"', 'path = "${MY_TOKEN}/spring.csv"'))
    assert "asks for the environment variable MY_TOKEN; allow it with --env MY_TOKEN" in told
    assert "set" not in told
    assert "/somewhere" not in told


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_variable_is_used_when_the_user_allows_it(backsight, tmp_path, monkeypatch, command):
    monkeypatch.setenv("MY_DATA", str(tmp_path))
    path = small_problem.write(
        tmp_path, changed('path = "spring.csv"', 'path = "${MY_DATA}/missing.csv"')
    )
    out = ("--out", tmp_path / "out") if command == "run" else ()
    code, _, told = backsight(command, path, *out, "--env", "MY_DATA")
    assert code == 2
    assert f"there is no file '{tmp_path / 'missing.csv'}'" in told


def test_missing_column(refused):
    told = refused(changed('column = "place"', 'column = "plaice"'))
    assert "no column 'plaice'" in told
    assert "did you mean 'place'?" in told


def test_cell_that_is_no_number(refused, tmp_path):
    rows = cells()
    rows[41][2] = "n.a."
    write_recording(tmp_path, rows)
    told = refused()
    assert "line 43, column 'place': 'n.a.' is not a number" in told


def test_empty_recording(refused, tmp_path):
    write_recording(tmp_path, [])
    assert "the recording has 0 samples" in refused()


def test_time_that_does_not_increase(refused, tmp_path):
    rows = cells()
    rows[10][0] = rows[9][0]
    write_recording(tmp_path, rows)
    assert "time does not increase at sample 10" in refused()


def test_irregular_time_says_how_to_resample(refused, tmp_path):
    rows = cells()
    rows[10][0] = repr(float(rows[10][0]) + 0.02 * small_problem.DT)
    write_recording(tmp_path, rows)
    told = refused()
    assert "time is irregular" in told
    assert "resample = 0.01" in told


@pytest.mark.parametrize("value", ["nan", "inf", ""])
def test_input_that_is_not_known(refused, tmp_path, value):
    rows = cells()
    rows[7][1] = value
    write_recording(tmp_path, rows)
    told = refused()
    assert "input 'u' is " in told
    assert "at sample 7" in told


def test_recording_that_does_not_fit_into_memory(refused, monkeypatch):
    free = types.SimpleNamespace(available=1000)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: free)
    told = refused()
    assert "200 samples would take" in told
    assert "of memory" in told


# the numbers


ZEROS = [[0.0] * 4 for _ in range(4)]


@pytest.mark.parametrize(
    ("table", "old", "key"),
    [
        ("noise", "sigma_y = { y = 1e-4 }", "R"),
        ("noise", "[estimators.EKF]", "Q"),
        ("noise", "[estimators.EKF]", "Qc"),
        ("prior", "sigma_x0 = { q = 0.01, v = 0.1 }", "P0"),
    ],
)
def test_covariance_of_the_wrong_size_or_not_positive_definite(refused, table, old, key):
    base = small_problem.TEXT
    if key == "P0":
        base = base.replace(", sigma = 30.0", "").replace(", sigma = 1.0", "")
    size = 1 if key == "R" else 4
    indefinite = np.diag([-2.0, *([1.0] * (size - 1))]).tolist()
    rest = old if old.startswith("[") else ""
    told = refused(base.replace(old, f"{key} = {indefinite}\n{rest}"))
    assert f"{table}: {key} is not positive" in told
    assert "its smallest eigenvalue is -2" in told
    large = np.eye(size + 1).tolist()
    told = refused(base.replace(old, f"{key} = {large}\n{rest}"))
    assert f"{table}: {key} has the shape ({size + 1}, {size + 1})" in told
    ragged = [[1.0], [1.0, 2.0]]
    told = refused(base.replace(old, f"{key} = {ragged}\n{rest}"))
    assert f"{table}.{key}: its rows have different lengths" in told


def test_standard_deviations_that_cannot_be(refused):
    assert "noise: sigma_y must not be negative" in refused(changed("y = 1e-4", "y = -1e-4"))
    told = refused(changed("q = 0.01, v = 0.1", "q = 0.01"))
    assert "prior: sigma_x0 gives no standard deviation for v" in told
    told = refused(changed("q = 0.01, v = 0.1", "q = 0.01, v = 0.1, k = 3.0"))
    assert "prior.sigma_x0.k: 'k' has a 'sigma' of its own" in told
    told = refused(changed("start = 80.0", "lower = 90.0, start = 80.0"))
    assert "estimate: " in told
    assert "'k' is 80.0, outside its bounds 90.0 to inf" in told


# the names


EQUATIONS = """\
kind = "equations"
states = { q = "m", v = "m/s" }
outputs = { y = "q" }
equations = { q = "v", v = "FORMULA" }"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[noise]", "[nose]", "nose: unknown key, did you mean 'noise'?"),
        ("time = ", "tim = ", "recording.tim: unknown key, did you mean 'time'?"),
        ('"force"', '"force", units = "N"', "recording.inputs.u.units: unknown key, did you mean"),
        ("start = 80.0", "strt = 80.0", "estimate.k.strt: unknown key, did you mean 'start'?"),
        ("N = 5", "alhpa = 1.0", "estimators.MHO.alhpa: unknown key, did you mean 'alpha'?"),
        ("N = 5", "N = 5.5", "estimators.MHO.N: must be a whole number, not 5.5"),
        ("N = 5", "N = 0", "estimators.MHO: the horizon N is 0"),
        ("N = 5", "optimiser.limit = 3", "estimators.MHO.optimiser.limit: unknown key, "),
        ("N = 5", "covariance = 'odd'", "estimators.MHO: unknown covariance 'odd'"),
        ('"mho"', '"mh0"', "estimators.MHO.kind: unknown kind 'mh0', did you mean 'mho'?"),
        ("[estimators.EKF]", '[estimators."a/b"]', "estimators.a/b: use letters, digits"),
        ('"sdof"', '"sodf"', "model.kind: unknown kind 'sodf', did you mean 'sdof'?"),
        ('kind = "sdof"\n', "", "model.kind: is missing; known: beam, duffing, equations, "),
        ("c = 1.0", "d = 1.0", "model.d: unknown key, "),
        ("c = 1.0", 'c = "1.0"', "model.c: must be a number, not '1.0'"),
        ("k = { start", "kk = { start", "model.k: is missing"),
        ("inputs.u", "inputs.F", "recording.inputs.F: the model has no input 'F', known: u"),
        ("outputs.y", "outputs.z", "recording.outputs.z: the model has no output 'z', "),
        ('"m" }', '"N" }', "recording.outputs.y.unit: the model takes 'y' in m, to which N cannot"),
        ('"m" }', '"banana" }', "recording.outputs.y.unit: 'banana' is no unit that is known"),
        ("sigma = 30.0", "sigma = 3.0, unit = '9**9**9**9'", "estimate.k.unit: '9**9**9**9' is no"),
        ("k = 100.0", "kk = 100.0", "reference.kk: the model has no state 'kk', did you mean 'k'?"),
        ('time = "t"', "", "give the column of time, or the sampling period dt"),
        ('title = "Mass', 'title = Mass', "is not TOML: Invalid value (at line 1, column 9)"),
        ("[prior]", "[disturbances]\nw.acts_on = 'a'\n[prior]", "disturbances.w.acts_on: no state"),
        ("[prior]", "[integrator]\nscheme = 'rk5'\n[prior]", "integrator: unknown scheme 'rk5'"),
        ("[prior]", "[integrator]\nstep = 1\n[prior]", "integrator.step: unknown key, "),
    ],
)  # fmt: skip
def test_names_and_values(refused, old, new, message):
    assert message in refused(changed(old, new))


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        ("u - k*q - bb*v", "equation 'v', column 11: unknown name 'bb': did you mean 'b'?"),
        ("u - k*q^2", "equation 'v', column 8: '^' is not allowed: write ** for a power"),
        ("__import__('os')", "equation 'v', column 1: unknown function '__import__'"),
        ("u.real", "equation 'v', column 2: '.' is not allowed"),
        ("u - (k*q", "equation 'v'"),
    ],
)
def test_equations(refused, formula, message):
    equations = EQUATIONS.replace("FORMULA", formula)
    told = refused(changed('kind = "sdof"\nc = 1.0', equations))
    assert f"model: {message}" in told


# the results


def test_folder_that_cannot_be_written(refused, tmp_path):
    (tmp_path / "file").write_text("")
    assert "cannot write to the folder" in refused(out=tmp_path / "file" / "out")


def test_an_estimator_that_fails_is_told_and_does_not_stop_the_others(backsight, tmp_path):
    exploding = EQUATIONS.replace("FORMULA", "u - k*q - b*v + 1e9*exp(100*q)")
    text = changed('kind = "sdof"\nc = 1.0', exploding)
    one_step = "[integrator]\nscheme = 'rk4'\nsubsteps = 1\n[prior]"
    path = small_problem.write(tmp_path, text.replace("[prior]", one_step))
    code, printed, told = backsight("run", path, "--out", tmp_path / "out")
    assert code == 1
    assert "EKF: ekf failed at sample 1 (t = 0.01 s): the estimate is no longer finite" in told
    assert printed.count("diverged\n") == 2
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        ".backsight.json",
        "estimates.nc",
        "report.html",
        "summary.json",
    ]
