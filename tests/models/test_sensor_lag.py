import numpy as np
import pytest
import scipy

import backsight as bs
from backsight.errors import ModelError
from backsight.models.lti import lti
from backsight.models.structures.sensor_lag import sensor_lag

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
    seen = response(sensor_lag(OSCILLATOR, {"a": CUTOFF}))
    raw, fine = on_a_fine_grid()
    np.testing.assert_allclose(seen[:, 1], low_pass(raw, CUTOFF, fine)[::fine], atol=0.01)
    np.testing.assert_allclose(seen[:, 0], response(OSCILLATOR)[:, 0], atol=1e-9)


def test_the_limit_is_before_the_low_pass():
    seen = response(sensor_lag(OSCILLATOR, {"a": CUTOFF}, limit={"a": 2.0}))
    raw, fine = on_a_fine_grid()
    assert np.abs(raw).max() > 4.0
    wanted = low_pass(np.clip(raw, -2.0, 2.0), CUTOFF, fine)[::fine]
    np.testing.assert_allclose(seen[:, 1], wanted, atol=0.01)


def test_a_limit_without_a_low_pass_clips_the_output():
    seen = response(sensor_lag(OSCILLATOR, {}, limit=2.0))
    np.testing.assert_allclose(seen, np.clip(response(OSCILLATOR), -2.0, 2.0), atol=1e-9)


def test_names_and_units():
    model = sensor_lag(OSCILLATOR, CUTOFF)
    assert [s.name for s in model.states] == ["q", "v", "q_out_sensor", "a_sensor"]
    assert [s.unit for s in model.states] == ["m", "m/s", "m", "m/s2"]
    assert model.outputs == OSCILLATOR.outputs


@pytest.mark.parametrize(
    ("model", "cutoff", "limit", "message"),
    [
        (OSCILLATOR, {"a": 0.0}, np.inf, "the cutoff of 'a' is 0; it must be positive"),
        (OSCILLATOR, 5.0, {"a": -1.0}, "the limit of 'a' is -1; it must be positive"),
        (OSCILLATOR, {"b": 5.0}, np.inf, "cutoff names 'b'"),
        (
            lti([[0.5]], [[1.0]], [[1.0]], states={"x": ""}, inputs={"u": ""},
                outputs={"y": ""}, dt=0.1),
            5.0, np.inf, "continuous in time",
        ),
    ],
)  # fmt: skip
def test_wrong_sensors_are_refused(model, cutoff, limit, message):
    with pytest.raises(ModelError, match=message):
        sensor_lag(model, cutoff, limit=limit)
