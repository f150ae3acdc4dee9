"""Dummy measurements and the high-pass in a problem file, and what `check` proposes."""

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from backsight.cli import app
from backsight.errors import ProblemError
from backsight.problem import load
from backsight.problem.recorded import recording_of

BEAM = """
[recording]
path = "beam.csv"
dt = 0.002
outputs.a = { column = "a", unit = "m/s2" }
[model]
kind = "modal"
frequencies = [8.0, 30.0]
sensors.a = { kind = "acceleration", at = [1.0, -1.0] }
forces.F = [1.0, 0.5]
[estimate]
F = { start = 0.0, sigma = 1.0, walk = 0.5 }
[virtual]
tip = { kind = "displacement", at = [1.0, 1.0] }
[prior]
sigma_x0 = { q1 = 1e-3, q2 = 1e-3, q1_dot = 1e-2, q2_dot = 1e-2 }
[noise]
sigma_y = { a = 0.02 }
[estimators.KF]
kind = "kf"
"""


def write(folder, more="", text=BEAM):
    values = np.random.default_rng(0).standard_normal(300)
    (folder / "beam.csv").write_text("a\n" + "\n".join(map(str, values)) + "\n")
    path = folder / "beam.toml"
    path.write_text(text + more)
    return path


def checked(path):
    ran = CliRunner().invoke(app, ["check", str(path)])
    return ran.exit_code, " ".join(ran.output.split())


def test_check_proposes_what_can_be_pasted(tmp_path):
    code, output = checked(write(tmp_path))
    assert code == 1
    line, factor = re.search(
        r'(dummy\.\w+ = \{ expression = "tip", sigma = )([0-9.]+) \* s', output
    ).groups()
    assert float(factor) == pytest.approx(np.sqrt(2 / (2 * np.pi * 8 * 0.002)), rel=0.05)
    assert "without a further sensor, a dummy measurement of tip would do" in output
    path = write(tmp_path, text=f"{line}{float(factor) * 1e-3:.3g} }}\n{BEAM}")
    code, output = checked(path)
    assert code == 0
    assert "observable" in output
    assert "without a further sensor" not in output
    assert "without a sensor, but measured as zero: tip_stays (dummy)" in output


def test_check_proposes_the_high_pass_by_name_beside_the_dummy(tmp_path):
    _, output = checked(write(tmp_path))
    cutoff = re.search(r"high_pass = ([0-9.]+) in \[recording\] \(Hz\)", output)[1]
    assert float(cutoff) == pytest.approx(8.0 / 5, rel=0.05)
    filtered = BEAM.replace("dt = 0.002", f"dt = 0.002\nhigh_pass = {cutoff}")
    _, output = checked(write(tmp_path, text=filtered))
    assert "a dummy measurement of tip would do" in output
    assert "high_pass" not in output


def test_the_table_makes_outputs_with_their_noise(tmp_path):
    more = '[dummy]\nroot = { kind = "displacement", at = [0.5, 0.0], sigma = 0.01 }\n'
    problem = load(write(tmp_path, more))
    root = problem.model.outputs[1]
    assert (root.name, root.unit, root.dummy) == ("root", "m", 0.0)
    assert [s.name for s in problem.model.virtual.signals] == ["tip"]
    noise, _ = problem.estimators["KF"].assumed
    np.testing.assert_allclose(noise.measurement(problem.model), np.diag([0.02**2, 0.01**2]))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('tip = { expression = "q1", sigma = 1.0 }', "dummy.tip: is the name of a virtual output"),
        ('d = { expression = "q1" }', "noise: sigma_y gives no standard deviation for d"),
        ('d = { kind = "acceleration", at = [1.0, 0.0], sigma = 1.0 }', "dummy: .* of a rate"),
        ("d = { at = [1.0, 0.0], sigma = 1.0 }", "dummy.d.kind: is missing"),
    ],
)
def test_what_is_wrong_is_named(line, message, tmp_path):
    with pytest.raises(ProblemError, match=message):
        load(write(tmp_path, f"[dummy]\n{line}\n"))


def test_the_high_pass_is_a_key_for_linear_models(tmp_path):
    text = BEAM.replace("dt = 0.002", "dt = 0.002\nhigh_pass = 2.0")
    problem = load(write(tmp_path, text=text))
    assert recording_of(problem).attrs["high_pass"] == 2.0
    pendulum = """[model]
kind = "equations"
states = { q = "rad", v = "rad/s" }
outputs = { a = "v" }
[model.equations]
q = "v"
v = "-9.81*sin(q)"
"""
    text = re.sub(r"\[model\].*?\[prior\]", lambda _: pendulum + "[prior]", text, flags=re.DOTALL)
    with pytest.raises(ProblemError, match="high_pass needs a linear model"):
        load(write(tmp_path, text=text))
