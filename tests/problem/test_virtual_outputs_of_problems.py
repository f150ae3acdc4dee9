"""Quantities without a sensor in a problem file, and in what a run writes."""

import json

import numpy as np
import pytest
import xarray as xr

import backsight as bs
import small_problem
from backsight.errors import ProblemError
from backsight.problem import load, run_problem

VIRTUAL = """
[virtual]
spring = { expression = "k*q", unit = "N/kg" }
a = "v_dot"
"""
BEAM = """
[recording]
path = "beam.csv"
dt = 0.01
outputs.y = { column = "y", unit = "m" }
[model]
kind = "beam"
length = 1.0
bending_stiffness = 100.0
mass_per_length = 2.0
thickness = 0.01
modes = 1
sensors.y = { kind = "displacement", at = 1.0 }
[prior]
sigma_x0 = { q1 = 1.0, q1_dot = 1.0 }
[noise]
sigma_y = { y = 1e-4 }
[estimators.KF]
kind = "kf"
[virtual]
"""


def test_a_run_writes_them_everywhere(tmp_path):
    path = small_problem.write(tmp_path, small_problem.TEXT + VIRTUAL)
    results = run_problem(load(path), tmp_path / "out", progress=lambda *_: None)
    for name, result in results.items():
        with xr.open_dataset(tmp_path / "out" / "estimates.nc", group=name) as read:
            xr.testing.assert_equal(read["z_hat"], result["z_hat"])
        k, q = (result["x_hat"].sel(state=n).values for n in ("k", "q"))
        np.testing.assert_allclose(result["z_hat"].sel(virtual="spring"), k * q, rtol=1e-12)
    written = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    entry = written["estimators"]["EKF"]["virtual"]["spring"]
    z, std = (results["EKF"][n].sel(virtual="spring").values for n in ("z_hat", "z_std"))
    assert entry == {
        "value": z[-1],
        "std": std[-1],
        "rms": pytest.approx(np.sqrt(np.mean(z**2))),
        "largest": np.abs(z).max(),
        "typical_std": np.median(std),
        "unit": "N/kg",
    }
    assert "spring [N/kg]" in str(results)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Where no sensor is" in page
    assert "virtual spring over time with bands" in page


def test_a_sensor_that_was_left_out_is_a_truth_to_compare_with(tmp_path):
    text = small_problem.TEXT.replace(
        'outputs.y = { column = "place", unit = "m" }',
        'outputs.y = { column = "place", unit = "m" }\ntruth.seen = "place"',
    )
    path = small_problem.write(tmp_path, text + '\n[virtual]\nseen = "q"\nother = "v"\n')
    results = run_problem(load(path), tmp_path / "out", progress=lambda *_: None)
    written = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    found = written["estimators"]["EKF"]["virtual"]
    assert 0 < found["seen"]["rms_error"] < 2e-4
    assert len(found["seen"]["within"]) == 3
    assert "within" not in found["other"]
    assert "(error" in str(results)


def test_structures_take_kind_and_place(tmp_path):
    path = tmp_path / "beam.toml"
    more = (
        'tip = { kind = "velocity", at = 1.0 }\nroot = { kind = "strain", at = 0.0, unit = "1" }\n'
    )
    path.write_text(BEAM + more + 'stress = { expression = "2e11*root", unit = "Pa" }\n')
    virtual = load(path).model.virtual
    assert [(s.name, s.unit) for s in virtual.signals] == [
        ("tip", "m/s"), ("root", "1"), ("stress", "Pa"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("z = {}", "virtual.z: give either an expression, or kind and at"),
        ('z = { kind = "strain" }', "virtual.z.at: is missing"),
        ("z = { at = 0.1 }", "virtual.z.kind: is missing"),
        ('z = { kind = "stress", at = 0.1 }', "model: virtual 'z' is a 'stress'"),
        ('z = { expression = "q7" }', "virtual: virtual output 'z', column 1: unknown name 'q7'"),
        ('z = { formula = "q1" }', "virtual.z.formula: unknown key"),
        ('q1 = "2*q1"', "'q1' has the name of another signal"),
    ],
)
def test_what_is_wrong_is_named_by_its_key(line, message, tmp_path):
    path = tmp_path / "beam.toml"
    path.write_text(BEAM + line + "\n")
    with pytest.raises(ProblemError, match=message.replace("(", r"\(")):
        load(path)


def test_a_model_without_places_has_formulas_only(tmp_path):
    text = small_problem.TEXT + '\n[virtual]\nz = { kind = "strain", at = 0.1 }\n'
    with pytest.raises(
        ProblemError, match=r"virtual\.z\.kind: a model of kind 'sdof' has no places"
    ):
        load(small_problem.write(tmp_path, text))


def test_a_stream_has_them_in_every_step():
    model = bs.with_virtual(bs.sdof(k=100.0, b=2.0), {"spring": "k*q"})
    ekf = bs.EKF(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=[0.1, 1.0]))
    live = bs.stream(ekf, model, 0.01, engine="vm")
    step = live.step([0.0] * model.nu, {"y": 0.02})
    assert step["z_hat"] == pytest.approx(100.0 * step["x_hat"][:1])
    assert step["z_std"] == pytest.approx(100.0 * np.sqrt(step["P"][:1, 0]))
