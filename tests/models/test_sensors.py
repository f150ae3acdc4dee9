import dataclasses

import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import ModelError, TuningError
from backsight.models import Sensor, augment, modal, with_sensors
from backsight.models.lti import lti

OSCILLATOR = lti(
    [[0.0, 1.0], [-900.0, -0.6]], [[0.0], [1.0]], [[1.0, 0.0], [-900.0, -0.6]], [[0.0], [1.0]],
    states={"q": "m", "v": "m/s"}, inputs={"F": "N"}, outputs={"q_out": "m", "a": "m/s2"},
)  # fmt: skip

DT, CUTOFF = 1e-3, 8.0


def response(model, n=400):
    u = np.where(np.arange(n) < 30, 5.0, 0.0)
    return bs.simulate(model, u, dt=DT)["y"].values


def low_pass(values, cutoff, fine):
    """The same low-pass with the transfer function, on a fine grid."""
    a = 2 * np.pi * cutoff
    time = np.arange(len(values)) * DT / fine
    return scipy.signal.lsim(([a], [1.0, a]), values, time)[1]


def on_a_fine_grid(n=400, fine=25):
    u = np.where(np.arange(n * fine) < 30 * fine, 5.0, 0.0)
    return bs.simulate(OSCILLATOR, u, dt=DT / fine, substeps=2)["y"].values[:, 1], fine


def test_the_low_pass_is_that_of_the_transfer_function():
    seen = response(with_sensors(OSCILLATOR, {"a": Sensor(cutoff=CUTOFF)}))
    raw, fine = on_a_fine_grid()
    np.testing.assert_allclose(seen[:, 1], low_pass(raw, CUTOFF, fine)[::fine], atol=0.01)
    np.testing.assert_allclose(seen[:, 0], response(OSCILLATOR)[:, 0], atol=1e-9)


def test_the_limit_is_before_the_low_pass():
    seen = response(with_sensors(OSCILLATOR, {"a": Sensor(cutoff=CUTOFF, limit=2.0)}))
    raw, fine = on_a_fine_grid()
    assert np.abs(raw).max() > 4.0
    wanted = low_pass(np.clip(raw, -2.0, 2.0), CUTOFF, fine)[::fine]
    np.testing.assert_allclose(seen[:, 1], wanted, atol=0.01)


def test_a_limit_without_a_low_pass_clips_the_output():
    seen = response(with_sensors(OSCILLATOR, {"q_out": Sensor(limit=2.0), "a": Sensor(limit=2.0)}))
    np.testing.assert_allclose(seen, np.clip(response(OSCILLATOR), -2.0, 2.0), atol=1e-9)


def test_names_and_units():
    model = with_sensors(
        OSCILLATOR,
        {"q_out": Sensor(cutoff=CUTOFF), "a": Sensor(cutoff=CUTOFF, gain=1.1, offset=0.2)},
    )
    assert [(s.name, s.value, s.unit) for s in model.parameters] == [
        ("a_gain", 1.1, ""), ("a_offset", 0.2, "m/s2"),
    ]  # fmt: skip
    assert [s.name for s in model.states] == ["q", "v", "q_out_sensor", "a_sensor"]
    assert [s.unit for s in model.states] == ["m", "m/s", "m", "m/s2"]
    assert model.outputs == OSCILLATOR.outputs


TOWER = modal(
    [4.15, 35.2], damping=[0.006, 0.004], forces={"F": [1.0, 0.7]},
    sensors={"a": ("acceleration", [1.0, 0.5]), "b": ("displacement", [0.3, -0.5])},
)  # fmt: skip
CHAIN = {"a": Sensor(limit=2.0, cutoff=49.0, gain=1.1, offset=0.2), "b": Sensor(cutoff=30.0)}
PUSH = np.where((np.arange(40) >= 5) & (np.arange(40) < 9), 5.0, 0.0)[:, None]


@pytest.fixture(scope="module")
def fine():
    """Readings of the continuous model, fifty for every sample."""
    through = bs.forces.forces_as_inputs(with_sensors(TOWER, CHAIN), ["F"])
    return bs.simulate(through, np.repeat(PUSH, 50, axis=0), dt=DT / 50, substeps=1)["y"].values


@pytest.mark.parametrize("late", [0.0, 3.1e-4, 1e-3])
def test_carried_from_part_to_part_it_is_the_continuous_one(fine, late):
    read_late = {**CHAIN, "a": dataclasses.replace(CHAIN["a"], late=late)}
    model = with_sensors(TOWER, read_late, dt=DT, parts=8)
    x, found = np.zeros(model.nx), []
    for f in PUSH[:, 0]:
        p = [f, 1.1, 0.2]
        found.append(np.array(model.h(x, [], p)).ravel())
        x = np.array(model.f(x, [], p)).ravel()
    found = np.array(found)
    moments = 50 * (np.arange(39) + late / DT)
    assert np.abs(found[:, 0]).max() > 1.5
    wanted = np.interp(moments, np.arange(len(fine)), fine[:, 0])
    np.testing.assert_allclose(found[:39, 0], wanted, atol=3e-4)
    np.testing.assert_allclose(found[:, 1], fine[::50, 1], atol=3e-4)


def test_an_unknown_gain_is_found_beside_the_motion():
    tower = modal(
        [4.15], damping=[0.006], sensors={"a": ("acceleration", [1.0])}, inputs={"F": [1.0]}
    )
    slow = with_sensors(tower, {"a": Sensor(cutoff=20.0, gain=1.0)}, dt=0.01)
    push = np.sin(0.2 * np.arange(300)) + np.sin(0.31 * np.arange(300))
    recording = bs.simulate(slow, push, dt=0.01, sigma_y=1e-3, seed=1, parameters={"a_gain": 0.5})
    prior = bs.Prior(sigma_x0={"q1": 0.1, "q1_dot": 0.1, "a_sensor": 1.0, "a_gain": 0.5})
    ekf = bs.EKF(bs.Noise(sigma_y=1e-3), prior)
    found = bs.estimate(ekf, augment(slow, ["a_gain"]), recording, engine="vm").isel(time=-1)
    assert float(found["x_hat"].sel(state="a_gain")) == pytest.approx(0.5, abs=2e-3)


DISCRETE = lti(
    [[0.5]], [[1.0]], [[1.0]], states={"x": ""}, inputs={"u": ""}, outputs={"a": ""}, dt=0.1
)


@pytest.mark.parametrize(
    ("model", "given", "dt", "message"),
    [
        (OSCILLATOR, {"b": Sensor(cutoff=5.0)}, None, "no output 'b'"),
        (DISCRETE, {"a": Sensor(cutoff=5.0)}, None, "continuous in time"),
        (OSCILLATOR, {"a": Sensor(late=1e-4)}, None, "the sampling period dt is needed"),
        (OSCILLATOR, {"a": Sensor(late=2e-3)}, DT, "a sample takes 0.001 s"),
        (bs.sdof(k=100.0, b=1.0), {"y": Sensor(cutoff=5.0)}, DT, "write parameters that are not"),
    ],
)  # fmt: skip
def test_wrong_sensors_are_refused(model, given, dt, message):
    with pytest.raises(ModelError, match=message):
        with_sensors(model, given, dt=dt)


@pytest.mark.parametrize("field", ["limit", "cutoff"])
def test_a_sensor_checks_itself(field):
    with pytest.raises(TuningError, match=f"{field} is 0"):
        Sensor(**{field: 0.0})
