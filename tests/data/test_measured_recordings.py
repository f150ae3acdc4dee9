"""The reader on measured data, which are not part of the package."""

import os
import pathlib

import numpy as np
import pytest

from backsight.data import Column, merge, read

SOURCES = {
    "emps/emps_estimation.csv": "the EMPS data set of nonlinearbenchmark.org",
    "silverbox/silverbox_multisine.csv": "the Silverbox data set of nonlinearbenchmark.org",
    "frame_hammer/y160_4hit_rest.npz": (
        "github.com/XERN0N/System-Dynamics-and-Identification-Project-Group-3"
    ),
}

pytestmark = pytest.mark.data


def measured(name):
    path = pathlib.Path(os.environ.get("BACKSIGHT_DATA", ""), name)
    if "BACKSIGHT_DATA" not in os.environ or not path.exists():
        pytest.skip(f"no {name} in the folder BACKSIGHT_DATA; it comes from {SOURCES[name]}")
    return path


def test_positioning_drive():
    path = measured("emps/emps_estimation.csv")
    force = {"F": Column("u_V", unit="N", factor=35.1507)}
    r = read(path, inputs=force, outputs={"q": "q_meas_m"}, time="t_s", truth={"F": "F_motor_N"})
    assert dict(r.sizes) == {"time": 24841, "input": 1, "output": 1, "state": 1}
    assert r.attrs["dt"] == pytest.approx(1e-3, rel=1e-6)
    np.testing.assert_allclose(r.u, r.x_true, rtol=1e-5)


def test_electronic_oscillator():
    path = measured("silverbox/silverbox_multisine.csv")
    drive, sensor = (Column(name, unit="V", remove_mean=True) for name in ("u_V", "y_V"))
    r = read(path, inputs={"u": drive}, outputs={"y": sensor}, time="t_s")
    assert r.sizes["time"] == 43350
    assert 1 / r.attrs["dt"] == pytest.approx(610.3516, rel=1e-6)
    assert abs(float(r.y.mean())) < 1e-12


def test_hammer_and_accelerometers_at_two_rates():
    path = measured("frame_hammer/y160_4hit_rest.npz")
    hammer = read(path, inputs={"F": "force_N"}, outputs={}, time="t_force_s")
    sensors = {f"a{k}": Column(f"acc_ms2[{k}]", unit="m/s2") for k in range(4)}
    frame = read(path, inputs={}, outputs=sensors, time="t_acc_s")
    merged = merge(hammer, frame)
    assert merged.attrs["dt"] == pytest.approx(0.60569e-3, rel=1e-4)
    assert int((~np.isnan(merged.y[:, 0])).sum()) == frame.sizes["time"]
    assert float(merged.u.max()) == pytest.approx(225.7, abs=0.1)
