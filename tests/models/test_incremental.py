"""The incremental model: matrices, increments of a recording, and freedom from bias."""

import numpy as np
import pytest

from backsight.data import increments
from backsight.errors import ModelError
from backsight.estimators.linear_windows import LinearMHE
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.builtin import sdof
from backsight.models.lti import lti, state_space
from backsight.models.views.incremental import incremental
from backsight.run.estimation import estimate
from backsight.schema import recording

A, B, C = np.array([[0.9, 0.2], [-0.1, 0.8]]), np.array([[0.1], [1.0]]), np.array([[1.0, 0.0]])
PLANT = lti(A, B, C, states={"q": "m", "v": "m/s"}, inputs={"f": "N"}, outputs={"y": "m"}, dt=1.0)


def test_matrices_and_names():
    found = incremental(PLANT)
    F, G, H, _ = state_space(found)
    np.testing.assert_array_equal(F, [[0.9, 0.2, 0], [-0.1, 0.8, 0], [0.9, 0.2, 1]])
    np.testing.assert_array_equal(G, [[0.1], [1.0], [0.1]])
    np.testing.assert_array_equal(H, [[0, 0, 1]])
    assert [s.name for s in found.states] == ["d_q", "d_v", "y"]
    assert [s.unit for s in found.states] == ["m", "m/s", "m"]
    assert [s.name for s in found.inputs] == ["d_f"]


def motion(n: int, *, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and inputs under a known random input and an unknown load beside it."""
    u = np.random.default_rng(1).standard_normal((n, 1))
    states, x = [], np.array([0.3, -0.2])
    for k in range(n):
        states.append(x)
        x = A @ x + B @ (u[k] + load[k])
    return np.array(states), u


def test_unknown_input_leaves_no_bias_once_its_step_has_left_the_window():
    N, step, n = 5, 20, 50
    load = np.where(np.arange(n) >= step, 2.0, 0.7)
    x, u = motion(n, load=load)
    data = recording(np.arange(float(n)), u=u, y=x @ C.T, inputs={"f": "N"}, outputs={"y": "m"},
                     dt=1.0)  # fmt: skip
    settings = {"noise": Noise(1.0), "prior": Prior(1.0), "N": N}
    found = estimate(LinearMHE(**settings), incremental(PLANT), increments(data))
    truth = np.hstack([np.diff(x, axis=0), (x @ C.T)[1:]])
    error = np.abs(found["x_hat"].values[1:] - truth).max(axis=1)
    # The first increment of a window comes from the input before it, so windows must begin at
    # sample 1: sample N + 1 is the first. The step acts on the increment of sample `step` + 1.
    assert error[N:step].max() < 1e-12
    assert error[step : step + N].max() > 0.1
    assert error[step + N :].max() < 1e-12
    plain = estimate(LinearMHE(**settings), PLANT, data)["x_hat"].values - x
    assert np.abs(plain[N:]).min(axis=0).max() > 0.5


def test_increments_of_a_recording():
    data = recording(np.arange(4.0), u=np.array([[1.0], [3.0], [3.0], [0.0]]), y=np.zeros((4, 1)),
                     inputs={"f": "N"}, outputs={"y": "m"}, dt=1.0)  # fmt: skip
    changed = increments(data)
    np.testing.assert_array_equal(changed["u"].values[:, 0], [0, 2, 0, -3])
    assert list(changed["input"].values) == ["d_f"]
    np.testing.assert_array_equal(data["u"].values[:, 0], [1, 3, 3, 0])


def test_models_without_an_incremental_form():
    with pytest.raises(ModelError, match="continuous"):
        incremental(sdof(k=1.0, b=0.1))
    direct = lti(A, B, C, [[0.5]], states={"q": "", "v": ""}, inputs={"f": ""}, outputs={"y": ""},
                 dt=1.0)  # fmt: skip
    with pytest.raises(ModelError, match="'f' acts directly on the output 'y'"):
        incremental(direct)
