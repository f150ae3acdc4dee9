"""Noise of a measured input is told from a model that answers its input wrongly."""

import numpy as np
import pytest

import backsight as bs
from backsight.analysis.consistency._input_noise import noise_of_inputs

DT, SAMPLES, NOISE, SENSOR = 1e-3, 3000, 0.05, 5e-7


def motion(kind: str) -> np.ndarray:
    t = DT * np.arange(SAMPLES)
    slow = np.sin(2 * np.pi * 1.3 * t)
    chirp = 0.8 * np.sin(2 * np.pi * (2 * t + 3 * t**2))
    if kind == "white":
        return np.random.default_rng(7).choice([-1.0, 1.0], SAMPLES)
    return 1.2 * (np.sign(slow) if kind == "jumps" else slow) + chirp


def judged(kind: str, *, gain: float = 1.0, noise: float = 0.0) -> tuple[bs.check.Consistency, str]:
    """Verdict on a right filter of an oscillator whose gain or measured input is wrong."""
    u = motion(kind)
    made = bs.simulate(bs.sdof(k=3000.0, b=10.0, c=100.0 * gain), u, dt=DT, sigma_y=SENSOR, seed=2)
    measured = u + noise * np.random.default_rng(3).standard_normal(SAMPLES)
    recording = made.assign(u=(made.u.dims, measured[:, None]))
    believed = bs.Noise(sigma_y=SENSOR, sigma_w={"v": 1e-4})
    filters = {"KF": bs.KalmanFilter(believed, bs.Prior(sigma_x0={"q": 1e-2, "v": 1.0}))}
    found = bs.compare(filters, bs.sdof(k=3000.0, b=10.0, c=100.0), recording)
    return bs.check.check_consistency(found["KF"]), found.verdicts()[-1]


@pytest.mark.parametrize("kind", ["smooth", "jumps"])
def test_noise_and_gain_are_told_apart(kind):
    found, verdict = judged(kind, noise=NOISE)
    assert found.noisy is not None
    assert "what is new in the input 'u' explains" in verdict
    assert "answers its input wrongly" not in verdict
    found, verdict = judged(kind, gain=1.05)
    assert found.noisy is None
    assert "what is new" not in verdict
    found, verdict = judged(kind)
    assert found.noisy is None
    assert found.driven is None


def test_white_input_tells_nothing():
    found, verdict = judged("white", gain=1.05)
    assert found.noisy is None
    assert "answers its input wrongly" in verdict
    assert "what is new" not in verdict


def test_share_is_that_of_the_noise_itself():
    # Innovations that are a filtered noise of the input and some of their own, in known shares.
    rng = np.random.default_rng(5)
    noise, own = rng.standard_normal((2, SAMPLES))
    e = np.r_[0.0, 0.0, 0.6 * noise[1:-1] - 0.3 * noise[:-2]] + own
    share = 0.45 / 1.45
    smooth = np.cumsum(np.cumsum(1e-2 * rng.standard_normal(SAMPLES)))
    found = noise_of_inputs(e, np.column_stack([motion("smooth"), smooth + noise]), 10)
    assert found.share == pytest.approx(share, abs=0.05)
    assert found.p < 1e-12
    assert found.input == 1
    assert noise_of_inputs(own, (smooth + noise)[:, None], 10).p > 1e-3


def test_few_samples_say_nothing():
    assert np.isnan(noise_of_inputs(np.ones(100), np.ones((100, 1)), 10).share)
