"""Delays, wrong units and wrong signs of recordings, and none where there are none."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from analysis.noiseless import Noiseless
from backsight.analysis.alignment import decide, ratio
from backsight.data import from_arrays
from backsight.discrete.exact import zoh
from backsight.errors import TuningError
from backsight.estimators import KalmanFilter, Noise, Prior
from backsight.models.builtin import sdof
from backsight.models.lti import lti
from backsight.problem import load
from backsight.problem.recorded import recording_of
from backsight.run.diagnosis import aligned, check_alignment
from backsight.run.simulation import simulate
from backsight.signals import prbs
from backsight_studies.nanopositioner.plant import SAMPLES, simulate_stage
from backsight_studies.nanopositioner.tuning import ekf, joint_model

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def stage() -> xr.Dataset:
    return simulate_stage(3, samples=SAMPLES)


def changed(data: xr.Dataset, *, late: int = 0, factor: float = 1.0) -> xr.Dataset:
    """The recording with y so many samples late and in other units."""
    return data.assign(y=(data.y.dims, factor * np.roll(data.y.values, late, axis=0)))


def found(data: xr.Dataset):
    return check_alignment(ekf().estimator, joint_model(), data)


def test_right_recording_raises_no_alarm(stage):
    for data in (stage, simulate_stage(4, samples=SAMPLES, mode2=0.3)):
        result = found(data)
        assert result.sound
        assert result.aligned
        assert abs(result.fraction) < 0.1
        assert result.lines()[0].startswith("y and u are aligned: ")
        assert result.lines()[1].startswith("Units and signs look right: 'y' 1.")


@pytest.mark.parametrize(
    ("late", "says"),
    [
        (1, "probably misaligned by one sample: y is late (shift y by -1"),
        (-1, "probably misaligned by one sample: y is early (shift y by +1"),
        (3, "probably misaligned by 3 samples: y is late (shift y by -3"),
    ],
)
def test_shifted_output_is_found(stage, late, says):
    result = found(changed(stage, late=late))
    assert (result.delay, result.aligned, result.sound) == (late, False, False)
    assert says in str(result)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (1e3, r"about 1\d{3} times larger .* \(milli or kilo\?\)"),
        (1e-3, r"about \d{3} times smaller .* \(milli or kilo\?\)"),
        (2 * np.pi, r"about \d\.\d times larger .*2π"),
        (-1.0, "opposite sign of the model's response"),
        (-1e3, r"larger .* and of opposite sign \(milli or kilo\?\)"),
    ],
)
def test_wrong_units_and_signs_are_found_whatever_the_delay(stage, factor, says):
    for late in (0, -1):
        result = found(changed(stage, late=late, factor=factor))
        assert result.delay == late
        assert not result.sound
        assert re.search(says, str(result)), str(result)


def test_gaps_are_no_obstacle(stage):
    rng = np.random.default_rng(1)
    gappy = stage.assign(y=stage.y.where(rng.random(stage.sizes["time"])[:, None] > 0.3))
    assert found(gappy).sound
    assert found(changed(gappy, late=1)).delay == 1


def test_delay_of_half_a_sample_is_mentioned_and_no_alarm():
    """An input that rises between samples, taken for one that is held."""
    machine = sdof(k=4e4, b=20.0, c=1.0)
    made = simulate(
        machine, prbs(3000, seed=2, samples_per_bit=3), dt=1e-3, sigma_y=1e-9, hold="foh"
    )
    noise, prior = Noise(sigma_y=1e-7, sigma_w={"v": 1e-4}), Prior(sigma_x0=[1e-4, 1e-2])
    held = check_alignment(KalmanFilter(noise, prior), machine, made)
    assert abs(held.fraction) == pytest.approx(0.5, abs=0.1)
    assert "of a sample" in str(held) or held.aligned is None
    ramp = check_alignment(KalmanFilter(noise, prior, hold="foh"), machine, made)
    assert ramp.aligned
    assert abs(ramp.fraction) < 0.1


def test_recording_without_information_is_not_judged(stage):
    silent = stage.assign(u=0.0 * stage.u)
    result = found(silent)
    assert result.delay == 0
    assert result.aligned is None
    assert "cannot be told" in result.lines()[0]
    assert "cannot be compared" in result.lines()[1]


def test_noise_alone_is_never_misaligned():
    names = {"states": {"x": ""}, "inputs": {"u": ""}, "outputs": {"y": ""}}
    model = lti([[0.9]], [[1.0]], [[1.0]], dt=1.0, **names)
    judge = KalmanFilter(Noise(sigma_y=1.0, sigma_w=0.1), Prior(sigma_x0=1.0))
    rng = np.random.default_rng(0)
    for _ in range(5):
        u = 1e-3 * rng.standard_normal(400)
        data = simulate(model, u, dt=1.0, sigma_y=1.0, seed=int(rng.integers(1000)))
        assert check_alignment(judge, model, data).delay == 0


def test_models_without_input_have_nothing_to_align(stage):
    names = {"states": {"x": ""}, "inputs": {}, "outputs": {"y": ""}}
    free = lti([[0.9]], np.zeros((1, 0)), [[1.0]], dt=1e-4, **names)
    judge = KalmanFilter(Noise(sigma_y=1.0), Prior(sigma_x0=1.0))
    assert not check_alignment(judge, free, stage).shifts
    assert aligned({"KF": judge}, free, stage) is None


def test_estimator_without_noise_cannot_judge(stage):
    unknown = Noiseless()
    with pytest.raises(TuningError, match="no noise and prior"):
        check_alignment(unknown, joint_model(), stage)
    assert aligned({"none": unknown, "EKF": ekf().estimator}, joint_model(), stage) is not None


def test_reach_must_be_positive(stage):
    with pytest.raises(TuningError, match="reach"):
        check_alignment(ekf().estimator, joint_model(), stage, reach=0)


def test_one_part_of_the_recording_does_not_decide():
    """A gain of a thousand in one part counts less than small losses in all the others."""
    scores = {s: np.full(400, -float(abs(s))) for s in range(-2, 3)}
    scores[1] += 0.9
    scores[1][:10] += 1e3
    result = decide(scores, {s: 1.0 + abs(s) for s in scores}, ())
    assert result.best == 1
    assert result.delay == 0
    assert result.aligned is None


def test_delay_at_the_end_of_the_search_is_not_believed():
    scores = {s: np.full(400, 0.1 * s) for s in range(-2, 3)}
    result = decide(scores, {s: 1.0 - 0.1 * s for s in scores}, ())
    assert result.delay == 0
    assert not result.sound
    assert "the end of the search" in str(result)


def test_ratio_looks_through_drift_and_a_resonance_at_the_wrong_place():
    rng = np.random.default_rng(3)
    u = rng.standard_normal(1500)
    response, measured = (
        simulate(sdof(k=k, b=6.0, c=1.0), u, dt=5e-3, substeps=4)["y"].values[:, 0]
        for k in (900.0, 1100.0)
    )
    drift = 10 * np.ptp(measured) * np.linspace(-1, 1, 1500) ** 3
    result = ratio("y", 50 * measured + drift, response)
    assert result.size == pytest.approx(50.0, rel=0.05)
    assert result.direction > 0.8


OSCILLATOR = np.array([[0.0, 1.0], [-400.0, -2.0]])
TOGETHER = {
    name: lti(
        OSCILLATOR, [[0.0], [400.0]], rows, states={"q": "", "v": ""}, inputs={"u": ""}, outputs=out
    )
    for name, rows, out in (
        ("q", [[1.0, 0.0]], {"q_m": ""}),
        ("qv", np.eye(2), {"q_m": "", "v_m": ""}),
    )
}


def sampled_late(late: tuple[float, float], *, force: float = 0.0, n: int = 1500):
    """A held input, and two outputs that are read so many samples late, by exact fine steps."""
    fine, dt, rng = 50, 0.01, np.random.default_rng(1)
    u = np.repeat(0.3 * rng.standard_normal(n // 5), 5)
    F, G = zoh(OSCILLATOR, [[0.0], [400.0]], dt=dt / fine)
    x, states, unknown = np.zeros(2), np.empty((n * fine, 2)), 0.0
    for k in range(n):
        unknown = 0.98 * unknown + 0.2 * rng.standard_normal()
        for j in range(fine):
            states[k * fine + j] = x
            x = F @ x + G[:, 0] * (u[k] + force * unknown)
    at = [np.clip(np.arange(n) * fine - round(s * fine), 0, None) for s in late]
    y = np.column_stack([states[a, i] for i, a in enumerate(at)])
    return u, y + rng.standard_normal((n, 2)) * [1e-3, 2e-2]


def of_one(late: float, **changes: float):
    u, y = sampled_late((late, late), **changes)
    data = from_arrays(u=u, y=y[:, 0], dt=0.01, inputs={"u": ""}, outputs={"q_m": ""})
    judge = KalmanFilter(Noise(sigma_y=1e-3, sigma_w=[0.0, 0.02]), Prior(sigma_x0=[1.0, 20.0]))
    return check_alignment(judge, TOGETHER["q"], data)


@pytest.mark.parametrize("late", [0.74, 1.3])
@pytest.mark.parametrize("force", [0.0, 0.1])
def test_fractional_delay_is_found_with_its_band(late, force):
    result = of_one(late, force=force)
    value, std = result.fine
    assert abs(value - late) < 3 * std < 0.15
    assert result.delay == 1
    assert not result.sound
    assert re.search(
        rf"misaligned by {value:.2f} ± 0.0\d samples: .*the nearest whole", str(result)
    )


def test_delay_between_two_whole_shifts_is_told_with_its_band():
    """Of half a sample none and one fit equally; the delay is known all the same."""
    result = of_one(0.5)
    value, std = result.fine
    assert abs(value - 0.5) < 3 * std < 0.15
    assert re.search(rf"{value:.2f} ± 0.0\d of a sample late, between two whole", str(result))


def test_missing_force_is_no_misalignment():
    for force in (0.3, 1.0):
        result = of_one(0.0, force=force)
        assert result.delay == 0
        assert result.sound


def test_channel_that_is_late_by_itself_is_named():
    judge = KalmanFilter(
        Noise(sigma_y=[1e-3, 2e-2], sigma_w=[0.0, 0.02]), Prior(sigma_x0=[1.0, 20.0])
    )
    names = {"inputs": {"u": ""}, "outputs": {"q_m": "", "v_m": ""}}
    for late, says in (
        ((0.0, 2.0), "'v_m' is probably late by 2 samples against the other outputs"),
        ((0.0, 0.0), "y and u are aligned"),
        ((1.0, 1.0), "misaligned by one sample: y is late"),
    ):
        u, y = sampled_late(late)
        result = check_alignment(judge, TOGETHER["qv"], from_arrays(u=u, y=y, dt=0.01, **names))
        assert says in result.lines()[0] or says in result.lines()[1], str(result)
        assert result.sound == (late == (0.0, 0.0))


@pytest.mark.data
@pytest.mark.skipif(not os.environ.get("BACKSIGHT_DATA"), reason="needs the measured recordings")
@pytest.mark.parametrize("name", ["emps", "silverbox"])
def test_measured_machines_are_aligned_and_a_delay_would_be_found(name):
    problem = load(EXAMPLES / name / "problem.toml")
    data, judge = recording_of(problem), problem.estimators["EKF"]
    result = check_alignment(judge, problem.model, data)
    assert result.sound
    assert result.aligned
    assert abs(result.fraction) < 0.2
    assert check_alignment(judge, problem.model, changed(data, late=1)).delay == 1
    assert check_alignment(judge, problem.model, changed(data, late=-1)).delay == -1


def test_a_shift_with_which_the_filter_diverged_tells_nothing():
    scores = {s: np.ones(40) for s in (-2, 0, 1)}  # that by -1 is left out
    made = decide(scores, dict.fromkeys(scores, 1.0), ())
    assert made.aligned is None
    assert "cannot be told" in str(made)
