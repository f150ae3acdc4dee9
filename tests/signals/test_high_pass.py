"""One high-pass filter for all signals of a recording."""

import numpy as np
import pytest

import backsight as bs
from backsight.discrete.exact import zoh
from backsight.errors import DataError
from backsight.models.lti import state_space

DT = 0.01
MODEL = bs.sdof(k=900.0, b=3.0, c=2.0)


def pushed():
    rng = np.random.default_rng(0)
    force = np.repeat(rng.standard_normal(60), 10)
    force[0] = 0.0
    force[:10] = 0.0
    return bs.simulate(MODEL, force + 5.0 * (np.arange(600) > 9), dt=DT)


def test_a_linear_model_holds_between_filtered_signals():
    filtered = bs.signals.high_pass(pushed(), 0.5)
    A, B, _, _ = state_space(MODEL)
    Ad, Bd = zoh(A, B, dt=DT)
    x, u = filtered["x_true"].sel(state=["q", "v"]).values, filtered["u"].values
    assert np.abs(x[1:] - x[:-1] @ Ad.T - u[:-1] @ Bd.T).max() < 1e-9 * np.abs(x).max() + 1e-7
    np.testing.assert_allclose(filtered["y"].values[:, 0], x[:, 0], atol=1e-12)
    assert abs(filtered["u"].values[300:].mean()) < 0.1
    assert filtered.attrs["high_pass"] == 0.5


def test_offsets_leave_nothing_behind():
    recording = pushed()
    moved = recording.assign(y=recording["y"] + 7.0)
    one, other = (bs.signals.high_pass(r, 1.0)["y"].values for r in (recording, moved))
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_what_cannot_be_filtered_is_said():
    recording = pushed()
    with pytest.raises(DataError, match="80 Hz is not below half the sampling rate, 50 Hz"):
        bs.signals.high_pass(recording, 80.0)
    recording["y"][17, 0] = np.nan
    with pytest.raises(DataError, match="'y' is missing at sample 17"):
        bs.signals.high_pass(recording, 0.5)
