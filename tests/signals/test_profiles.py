import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.errors import BacksightError
from backsight.signals import jerk_limited, punch_strokes, quintic, rest, sequence

positions = st.floats(-5.0, 5.0)
bounds = st.floats(0.05, 20.0)


def derivative(profile, time, order, h=1e-5):
    """Central difference of position or velocity."""
    low, high = profile.at(time - h), profile.at(time + h)
    name = ("position", "velocity")[order]
    return (getattr(high, name) - getattr(low, name)) / (2 * h)


def test_quintic_is_its_formula():
    profile = quintic(1.0, -2.0, duration=0.4)
    t = np.linspace(0.0, 0.4, 9)
    s = t / 0.4
    motion = profile.at(t)
    np.testing.assert_allclose(motion.position, 1 - 3 * (10 * s**3 - 15 * s**4 + 6 * s**5))
    np.testing.assert_allclose(
        motion.velocity, -3 / 0.4 * 30 * s**2 * (1 - s) ** 2, rtol=1e-12, atol=1e-12
    )
    assert np.abs(motion.velocity).max() == pytest.approx(15 / 8 * 3 / 0.4)
    fine = profile.at(np.linspace(0, 0.4, 100_001)).acceleration
    assert np.abs(fine).max() == pytest.approx(10 / np.sqrt(3) * 3 / 0.16, rel=1e-8)


@given(start=positions, distance=st.floats(0.01, 8.0), up=st.booleans(), v=bounds, a=bounds,
       j=bounds)  # fmt: skip
def test_jerk_limited_keeps_its_bounds_and_arrives(start, distance, up, v, a, j):
    end = start + distance * (1 if up else -1)
    profile = jerk_limited(start, end, speed=v, acceleration=a, jerk=j)
    motion = profile.at(np.linspace(0.0, profile.duration, 2001))
    assert profile.start == start
    size = max(abs(start), abs(end))
    assert profile.end == pytest.approx(end, rel=1e-9, abs=1e-9 * size)
    assert np.abs(motion.velocity).max() <= v * (1 + 1e-9)
    assert np.abs(motion.acceleration).max() <= a * (1 + 1e-9)
    slope = np.diff(motion.acceleration) / (profile.duration / 2000)
    assert np.abs(slope).max() <= j * (1 + 1e-6)
    last = profile.at(profile.duration * (1 - 1e-12))
    assert abs(last.velocity) < 1e-6 * v
    assert abs(last.acceleration) < 1e-6 * a


@pytest.mark.parametrize(
    ("limits", "pieces", "duration"),
    [
        # No bound but that on the jerk: four pieces of the cube root of D / 2 j.
        ({"speed": 100, "acceleration": 100, "jerk": 4}, 4, 4 * np.cbrt(1 / 8)),
        # Speed reached, acceleration not: ramps of sqrt(v / j), then D / v.
        ({"speed": 0.25, "acceleration": 100, "jerk": 4}, 5, 2 * np.sqrt(0.25 / 4) + 1 / 0.25),
        # Acceleration reached, speed not: 0.5 s of jerk, and D = A (tj + ta) (2 tj + ta).
        ({"speed": 100, "acceleration": 1, "jerk": 2}, 6, 4 * 0.5 + 2 * (np.sqrt(1.0625) - 0.75)),
        # Both: D / v + v / a + a / j.
        ({"speed": 0.5, "acceleration": 0.5, "jerk": 2}, 7, 1 / 0.5 + 0.5 / 0.5 + 0.5 / 2),
    ],
)
def test_only_the_pieces_that_are_needed(limits, pieces, duration):
    profile = jerk_limited(0.0, 1.0, **limits)
    assert profile.path.c.shape[1] == pieces
    assert profile.duration == pytest.approx(duration, rel=1e-12)


@pytest.mark.parametrize(
    "profile",
    [
        quintic(-1.0, 2.0, duration=0.7),
        jerk_limited(3.0, 1.0, speed=2.0, acceleration=8.0, jerk=90.0),
        sequence([quintic(0, 1, duration=0.3), rest(1, duration=0.2), quintic(1, 0, duration=0.3)]),
    ],
)
def test_velocity_and_acceleration_are_derivatives(profile):
    t = np.linspace(0.02, profile.duration - 0.02, 83)
    motion = profile.at(t)
    np.testing.assert_allclose(derivative(profile, t, 0), motion.velocity, atol=1e-6)
    np.testing.assert_allclose(derivative(profile, t, 1), motion.acceleration, atol=2e-3)


def test_after_the_end_it_stays_or_repeats():
    up, down = quintic(0.0, 1.0, duration=0.5), quintic(1.0, 0.0, duration=0.25)
    once = sequence([up, down])
    late = once.at([0.75, 2.0])
    np.testing.assert_array_equal(late.position, [once.end, once.end])
    np.testing.assert_array_equal(late.velocity, 0.0)
    np.testing.assert_array_equal(late.acceleration, 0.0)
    periodic = sequence([up, down], repeats=True)
    t = np.linspace(0.0, 0.74, 20)
    np.testing.assert_allclose(periodic.at(t + 1.5).position, once.at(t).position, atol=1e-14)
    np.testing.assert_allclose(periodic.at(t + 1.5).velocity, once.at(t).velocity, atol=1e-13)


def test_the_strokes_of_the_punch():
    strokes = punch_strokes()
    assert strokes.duration == pytest.approx(0.12)
    motion = strokes.at(np.linspace(0.0, 0.24, 24_001))
    assert np.ptp(motion.position) == pytest.approx(4e-3)
    assert np.abs(motion.velocity).max() == pytest.approx(15 / 8 * 4e-3 / 0.038)
    fast = strokes.at(np.linspace(0.08, 0.12, 4001))
    assert np.ptp(fast.position) == pytest.approx(1e-3)
    moving = fast.velocity[np.abs(fast.velocity) > 1e-9]
    assert np.sum(np.diff(np.sign(moving)) != 0) == 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: quintic(0, 1, duration=0.0), "duration is 0.0"),
        (lambda: quintic(np.nan, 1, duration=1.0), "start is nan"),
        (lambda: jerk_limited(0, 1, speed=1, acceleration=-1, jerk=1), "acceleration is -1"),
        (lambda: jerk_limited(1, 1, speed=1, acceleration=1, jerk=1), "does not move"),
        (lambda: rest(np.inf, duration=1.0), "position is inf"),
        (lambda: sequence([]), "at least one"),
        (lambda: sequence([rest(0, duration=1), rest(1, duration=1)]), "profile 0 ends at 0"),
        (lambda: sequence([quintic(0, 1, duration=1)], repeats=True), "profile 0 ends at 1"),
        (lambda: rest(0, duration=1.0).at(-0.1), "times must be finite"),
        (lambda: rest(0, duration=1.0).at([np.nan]), "times must be finite"),
    ],
)
def test_wrong_profiles(make, message):
    with pytest.raises(BacksightError, match=message):
        make()
