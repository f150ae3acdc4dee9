import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import scipy

from backsight.errors import DataError
from backsight_studies import STUDIES
from backsight_studies.frame_hammer import calibrate, source
from backsight_studies.frame_hammer import detect as detection
from backsight_studies.frame_hammer.calibrate import calibrated
from backsight_studies.frame_hammer.detect import detect, hits_among
from backsight_studies.frame_hammer.follow import (
    ADVANCE,
    LOOK,
    SAMPLES,
    Hit,
    Piece,
    Track,
    first_fit,
    follow,
    unexplained,
)
from backsight_studies.frame_hammer.rig import (
    DT,
    HEIGHTS,
    LSB,
    STEP,
    STRONG,
    SUBSTEPS,
    WEAK,
    WIDTHS,
)
from backsight_studies.frame_hammer.score import judged
from backsight_studies.frame_hammer.search import search
from backsight_studies.frame_hammer.source import Hammer, Recording, read
from backsight_studies.frame_hammer.straight import slow, straightened
from backsight_studies.frame_hammer.window import Fit, Pulse, Window, advanced, low_passed


def swinging(axis, *, size=60.0, seed=0):
    """A state of the beam, all modes excited."""
    modes = size * np.random.default_rng(seed).standard_normal(2 * axis.modes)
    return Fit(
        modes / np.repeat(np.arange(1, axis.modes + 1), 2) ** 0.5, np.zeros(0), np.zeros(4), 0.0
    )


def readings(window, fit, pulses=(), *, noise=0.05, seed=0):
    """What the sensors would show in a window."""
    y = -window.residual(np.zeros((4, window.samples)), window.columns(pulses), fit.unknowns)
    return y + noise * np.random.default_rng(seed).standard_normal(y.shape)


class TestWindow:
    def test_its_model_is_that_of_the_ordinary_differential_equations(self):
        """Against an integration of modes and sensors, from rest, with a hit."""
        window, pulse = Window(WEAK, 30), Pulse(60, 1, 2)
        fit = Fit(np.zeros(2 * WEAK.modes), np.array([0.05, 0.01]), np.zeros(4), 0.0)
        np.testing.assert_allclose(
            readings(window, fit, (pulse,), noise=0.0), integrated(pulse, fit.hits), atol=0.25
        )

    def test_the_state_is_carried_through_a_hit(self):
        start = dataclasses.replace(swinging(WEAK), hits=np.array([0.2, 0.03]))
        pulse, ahead = Pulse(40, 0, 1), 120
        long = np.tensordot(start.unknowns[:-4], Window(WEAK, 40).columns((pulse,)), 1)
        later = advanced(WEAK, start, ahead, (pulse,))
        short = np.tensordot(later, Window(WEAK, 20).free, 1)
        np.testing.assert_allclose(short, long[..., ahead : ahead + short.shape[-1]], atol=1e-6)

    def test_the_jacobian_is_that_of_differences(self):
        window, pulses = Window(WEAK, 20), (Pulse(60, 2, 2),)
        fit = dataclasses.replace(swinging(WEAK), hits=np.array([0.1, 0.0]))
        columns, y = window.columns(pulses), np.zeros((4, 20))
        found = window.jacobian(columns, fit.unknowns)
        for i in (0, 7, 2 * WEAK.modes, 2 * WEAK.modes + 1, -1):
            step = np.zeros(len(fit.unknowns))
            step[i] = 1e-6
            ends = [window.residual(y, columns, fit.unknowns + s * step) for s in (-1, 1)]
            np.testing.assert_allclose(found[i], (ends[0] - ends[1]).ravel() / 2e-6, atol=1e-4)

    def test_a_state_is_found_without_knowing_it(self):
        window, fit = Window(WEAK, SAMPLES), swinging(WEAK, size=40.0)
        y = readings(window, fit)
        assert unexplained(y, first_fit(window, y).cost) < 0.02


def integrated(pulse, hits):
    """Readings of 30 samples by a Runge-Kutta method of SciPy."""
    omega, ratio = np.abs(WEAK.poles), np.array(WEAK.damping)
    drive = hits[0] * WEAK.driven[pulse.height] + hits[1] * np.eye(WEAK.modes)[-1]
    middle, width = pulse.middle * STEP, WIDTHS[pulse.width]

    def force(t):
        phase = (t - middle) / width + 0.5
        return np.sin(np.pi * phase) * np.pi / (2 * width) if 0 < phase < 1 else 0.0

    def rate(t, z):
        q, v, s = np.split(z, [WEAK.modes, 2 * WEAK.modes])
        a = drive * force(t) - 2 * ratio * omega * v - omega**2 * q
        raw = np.clip(WEAK.seen.T @ a, -WEAK.limit, WEAK.limit)
        return np.concatenate([v, a, 2 * np.pi * WEAK.cutoff * (raw - s)])

    n = 2 * WEAK.modes + 4
    times = STEP * (SUBSTEPS * np.arange(30) + np.arange(4)[:, None])
    asked = np.unique(times)
    solved = scipy.integrate.solve_ivp(
        rate, (0, asked[-1]), np.zeros(n), t_eval=asked, rtol=1e-6, atol=1e-9, max_step=STEP / 2
    )
    y = np.stack([np.interp(times[j], asked, solved.y[2 * WEAK.modes + j]) for j in range(4)])
    return y - y.mean(axis=1, keepdims=True)


@pytest.mark.parametrize("height", range(3))
def test_a_hit_is_found_at_its_height_and_time(height):
    window = Window(WEAK, SAMPLES + ADVANCE + LOOK)
    pulse = Pulse(8 * 58 + 3, height, 2)
    fit = dataclasses.replace(swinging(WEAK, seed=height), hits=np.array([0.2, -0.02]))
    y = readings(window, fit, (pulse,))
    before = Fit(fit.modes, np.zeros(0), fit.sensors, 0.0)
    found = search(window, y, before, first=54, last=62, widths=(2,))
    best = min(found, key=lambda f: f.fit.cost)
    assert [f.pulse.height for f in found] == [0, 1, 2]
    assert best.pulse.height == height
    assert abs(best.pulse.middle - pulse.middle) <= 1
    assert best.fit.hits[0] == pytest.approx(0.2, rel=0.05)


def test_frequencies_and_limit_are_calibrated_blind(monkeypatch):
    monkeypatch.setattr(calibrate, "PIECES", 4)
    factors = 1 + 0.003 * np.random.default_rng(1).standard_normal(WEAK.modes)
    true = dataclasses.replace(
        WEAK, frequencies=tuple(np.array(WEAK.frequencies) * factors), limit=1.03 * WEAK.limit
    )
    here, model = Window(true, SAMPLES), Window(WEAK, SAMPLES)
    signals, pieces = [], []
    for seed in range(4):
        fit = swinging(true, seed=seed)
        y = readings(here, fit, seed=seed)
        start = model.fit(y, fit)
        signals.append(y.T)
        pieces.append(Piece(seed * SAMPLES, start, (), 0.0))
    found = calibrated(WEAK, np.concatenate(signals), pieces)
    wrong = np.array(WEAK.frequencies) / true.frequencies - 1
    left = np.array(found.frequencies) / true.frequencies - 1
    # The first modes hardly turn within one window.
    assert np.abs(left[2:8]).max() < 0.2 * np.abs(wrong[2:8]).max()
    assert found.limit == pytest.approx(true.limit, rel=0.01)


def test_straightened_signals_are_those_of_sensors_without_a_limit():
    """The fast modes are gone, and all channels are read at the same time."""
    chosen = slow(WEAK)
    pulse, long = Pulse(8 * 58 + 3, 1, 2), Window(WEAK, SAMPLES + ADVANCE + LOOK)
    still = Fit(np.zeros(2 * WEAK.modes), np.zeros(0), np.zeros(4), 0.0)
    struck = dataclasses.replace(still, hits=np.array([0.2, 0.01]))
    pieces = (Piece(0, still, (), 0.0), Piece(0, struck, (pulse,), 0.0))
    y = readings(long, struck, (pulse,), noise=0.0).T
    found = straightened(Track(WEAK, (), pieces, 0), y)
    few = Window(dataclasses.replace(WEAK.only(chosen), limit=np.inf), long.samples)
    raw = np.tensordot(struck.hits, few.columns((pulse,))[-2:], 1)
    wanted = low_passed(WEAK, raw)[:, ::SUBSTEPS].T
    offset = np.median(found - wanted, axis=0)
    np.testing.assert_allclose(found - offset, wanted, atol=1e-6)
    assert np.abs(wanted).max() > 2 * np.abs(y).max()


def hit(sample, impulse, height=1.6):
    return Hit(sample, height, impulse, 2, np.array([0.5, 0.6, 0.9]), 0.3)


def test_rebounds_are_no_hits():
    pulses = (hit(100.0, -0.2), hit(150.0, -0.02), hit(700.0, -0.3))
    assert [h.sample for h in hits_among(pulses)] == [100.0, 700.0]
    assert hits_among(()) == ()
    assert pulses[0].margin == pytest.approx(4.0)


def test_the_score_counts_what_it_says():
    true = Hammer(
        np.array([0.5, 1.0, 1.05, 2.0, 3.0, 3.98]), np.full(6, 1.24), np.array([1.0] * 5 + [9.0])
    )
    found = Hammer(
        np.array([0.501, 1.0, 1.05, 2.004, 2.5, 3.99]),
        np.array([1.24, 1.24, 1.24, 0.81, 1.24, 1.24]),
        np.array([-1.1, 2.0, 2.0, 0.9, 1.0, 1.0]),
    )
    score = judged(found, true, begin=0.0, end=4.0)
    assert (score.isolated, score.found, score.right) == (3, 2, 1)
    assert (score.false, score.reported) == (2, 6)
    assert score.latest == pytest.approx(0.004)
    assert score.share_right == pytest.approx(1 / 3)
    assert score.share_false == pytest.approx(2 / 6)
    assert score.scale == pytest.approx(1.0)
    assert judged(found, true, begin=0.45, end=4.2).isolated == 3


def test_what_is_not_the_rig_is_refused(monkeypatch):
    monkeypatch.setattr(detection, "LOOKED_AT", 1)
    noise = LSB * np.round(100 * np.random.default_rng(0).standard_normal((400, 4)))
    with pytest.raises(DataError, match="not those of the rig"):
        detect(noise)


def measured(name):
    path = Path(os.environ.get(source.VARIABLE, ""), source.FOLDER, f"{name}.npz")
    if not os.environ.get(source.VARIABLE) or not path.exists():
        pytest.skip(f"no {name}.npz in the folder BACKSIGHT_DATA; it comes from {source.SOURCE}")
    return read(path)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "axis", "widths", "begin", "end", "hits"),
    [("x160_multi", WEAK, (2,), 280, 950, 2), ("y160_4hit_rest", STRONG, (0,), 0, 730, 2)],
)
def test_measured_hits_are_found(name, axis, widths, begin, end, hits):
    recording = measured(name)
    track = follow(axis, recording.y[begin:end], widths=widths)
    true = recording.hammer
    inside = (true.time > DT * begin) & (true.time < DT * (end - LOOK))
    assert inside.sum() == hits
    found = DT * (begin + np.array([h.sample for h in track.hits]))
    assert len(found) == hits
    assert np.abs(found - true.time[inside]).max() < 5e-3
    assert [h.height for h in track.hits] == [1.6] * hits
    assert track.lost == 0


@pytest.mark.slow
@pytest.mark.data
def test_the_study_meets_all_its_checks(tmp_path):
    measured("x160_multi")
    findings = STUDIES["frame_hammer"].run(tmp_path / "out", seeds=(5,))
    assert [check.name for check in findings.checks if not check.passed] == []
    assert findings.page.exists()


@pytest.mark.slow
@pytest.mark.parametrize("height", HEIGHTS)
def test_hits_in_the_strong_direction_are_found_at_every_height(height):
    from backsight_studies.frame_hammer.synthetic import simulated

    recording = simulated(height, seed=3, axis=STRONG)
    assert isinstance(recording, Recording)
    found = detect(recording.y)
    score = judged(
        Hammer(
            recording.times([h.sample for h in found.hits]),
            np.array([h.height for h in found.hits]),
            np.array([h.impulse for h in found.hits]),
        ),
        recording.hammer,
        begin=0.0,
        end=recording.end,
    )
    assert found.start is STRONG
    assert score.right == score.isolated == 3
    assert score.false == 0
