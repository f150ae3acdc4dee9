"""What a problem file says of sensors: angles that start anew, and steps."""

import numpy as np
import pytest
from typer.testing import CliRunner

from backsight.cli import app
from backsight.errors import ProblemError
from backsight.problem import load

SHAFT = """
[recording]
path = "shaft.csv"
dt = 0.01
outputs.y = { column = "angle", unit = "rad" }
[model]
kind = "equations"
states = { angle = "rad", speed = "rad/s" }
outputs = { y = "angle" }
[model.equations]
angle = "speed"
speed = "0"
[prior]
sigma_x0 = { angle = 0.5, speed = 5.0 }
[noise]
sigma_y = { y = 1e-3 }
sigma_w = { speed = 1e-3 }
[estimators.KF]
kind = "kf"
"""


def write(folder, of_output=""):
    angle = (3.0 * 0.01 * np.arange(700) + np.pi) % (2 * np.pi) - np.pi
    (folder / "shaft.csv").write_text("angle\n" + "\n".join(f"{a:.2f}" for a in angle) + "\n")
    path = folder / "shaft.toml"
    path.write_text(SHAFT.replace('unit = "rad" }', f'unit = "rad"{of_output} }}', 1))
    return path


def checked(path):
    ran = CliRunner().invoke(app, ["check", str(path)])
    return ran.exit_code, " ".join(ran.output.split())


def test_check_says_what_readings_look_like_and_what_to_write(tmp_path):
    code, output = checked(write(tmp_path))
    assert code == 1
    assert "'y' jumps by nearly a turn (6.283) 3 times" in output
    assert 'with wrap = "2*pi" on this output' in output
    assert "with resolution = 0.01 on this output" in output
    code, output = checked(write(tmp_path, ', wrap = "2*pi", resolution = 0.01'))
    assert code == 0, output
    assert "jumps" not in output
    assert "its resolution of 0.0100 counts as noise of 0.0029" in output


def test_a_turn_may_be_a_number_or_text(tmp_path):
    for given in ('"2*pi"', "6.283185307179586"):
        (output,) = load(write(tmp_path, f", wrap = {given}")).model.outputs
        assert output.wrap == pytest.approx(2 * np.pi, rel=1e-15)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("wrap = -1.0", "recording.outputs.y: wrap"),
        ('wrap = "turn"', "recording.outputs.y.wrap: the number, column 1: unknown name 'turn'"),
        ("resolution = 0.0", "recording.outputs.y: resolution"),
        ("wraps = 360", "recording.outputs.y.wraps: unknown key"),
    ],
)
def test_what_is_wrong_is_named(given, message, tmp_path):
    with pytest.raises(ProblemError, match=message):
        load(write(tmp_path, f", {given}"))


def test_a_clipped_sensor_is_seen_and_its_range_is_a_key(tmp_path):
    path = write(tmp_path)
    angle = np.clip(np.sin(0.01 * np.arange(700)), -1, 0.7)
    (tmp_path / "shaft.csv").write_text("angle\n" + "\n".join(f"{a:.4f}" for a in angle) + "\n")
    code, output = checked(path)
    assert code == 1
    assert "with saturation = [-inf, 0.7] on this output" in output
    path.write_text(path.read_text().replace('"rad" }', '"rad", saturation = [-inf, 0.7] }', 1))
    code, output = checked(path)
    assert "count as not measured" in output
    assert "looks clipped" not in output
    assert load(path).model.outputs[0].saturation == (-np.inf, 0.7)


TOWER = """
[recording]
path = "tower.csv"
dt = 0.001
outputs.a = { column = "a", unit = "m/s2" }
[model]
kind = "modal"
frequencies = [4.0]
damping = [0.01]
sensors = { a = { kind = "acceleration", at = [1.0] } }
forces = { hit = [1.0] }
[readings]
dt = 0.001
outputs.a = { limit = 50.0, cutoff = 45.0, late = 1.4e-4, offset = 0.1 }
[estimate.a_offset]
start = 0.0
sigma = 1.0
[prior]
sigma_x0 = { q1 = 0.01, q1_dot = 0.1, a_sensor = 1.0 }
[noise]
sigma_y = { a = 0.1 }
[estimators.EKF]
kind = "ekf"
"""


def test_readings_are_seen_through_a_sensor_that_is_part_of_the_model(tmp_path):
    (tmp_path / "tower.csv").write_text("a\n" + "0.5\n" * 40)
    path = tmp_path / "tower.toml"
    path.write_text(TOWER)
    model = load(path).model
    assert [s.name for s in model.states] == ["q1", "q1_dot", "a_sensor", "a_offset"]
    assert model.dt == 0.001
    path.write_text(TOWER.replace("outputs.a = { limit", "outputs.b = { limit"))
    with pytest.raises(ProblemError, match=r"readings.*no output 'b'"):
        load(path)
    path.write_text(TOWER.replace("late = 1.4e-4", "late = 2e-3"))
    with pytest.raises(ProblemError, match=r"readings.*a sample takes 0.001 s"):
        load(path)
