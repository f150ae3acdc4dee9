"""The band-pass filter and the speed by central differences."""

import numpy as np
import pytest
from scipy.signal import freqz

from backsight.errors import BacksightError, DataError
from backsight.signals import bandpass, central_difference, filtered

DT = 1e-4

COEFFICIENTS = {
    0.1: (
        0.01848510017378176,
        [1.0, -2.8088733826799777, 2.701942124674795, -0.888422929602272],
    ),
    0.05: (
        0.018737804076319576,
        [1.0, -2.8344347044482983, 2.752550193502105, -0.9134061652433609],
    ),
}
"""Damping ratio to b[0] and a at 10 kHz, from an independent implementation; 0.05 is as printed."""


@pytest.mark.parametrize("damping", COEFFICIENTS)
def test_coefficients(damping):
    b, a = bandpass(DT, damping=damping)
    gain, expected = COEFFICIENTS[damping]
    np.testing.assert_allclose(b, gain * np.array([1, 1, -1, -1]), atol=1e-12)
    np.testing.assert_allclose(a, expected, atol=1e-12)


@pytest.mark.parametrize("hertz", [10.0, 100.0, 423.0, 450.0, 1100.0])
def test_response_is_that_of_the_continuous_filter_at_the_warped_frequency(hertz):
    b, a = bandpass(DT, cutoff=80.0, frequency=400.0, damping=0.2)
    _, response = freqz(b, a, worN=[hertz], fs=1 / DT)
    s = 2j / DT * np.tan(np.pi * hertz * DT)
    wn = 2 * np.pi * 400.0
    expected = s / (s + 2 * np.pi * 80.0) * wn**2 / (s**2 + 0.4 * wn * s + wn**2)
    np.testing.assert_allclose(response, expected, rtol=1e-9)


def test_filtering_is_the_difference_equation_from_rest():
    values = np.random.default_rng(0).standard_normal((30, 2))
    b, a = bandpass(DT)
    by_hand = np.zeros_like(values)
    for k in range(len(values)):
        for i in range(4):
            if k >= i:
                by_hand[k] += b[i] * values[k - i] - (a[i] * by_hand[k - i] if i else 0)
    np.testing.assert_allclose(filtered(values, b=b, a=a), by_hand, atol=1e-13)
    np.testing.assert_allclose(filtered(values[:, 0], b=b, a=a), by_hand[:, 0], atol=1e-13)


def test_missing_samples_cannot_be_filtered():
    b, a = bandpass(DT)
    with pytest.raises(DataError, match="sample 2 is not finite"):
        filtered([0.0, 1.0, np.nan, 0.0], b=b, a=a)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"damping": 0.0}, "must be positive"),
        ({"cutoff": -1.0}, "must be positive"),
        ({"frequency": np.nan}, "must be positive"),
        ({"frequency": 5000.0}, "5000 Hz is not below half the sampling rate, 5000 Hz"),
    ],
)
def test_arguments_out_of_range(arguments, message):
    with pytest.raises(BacksightError, match=message):
        bandpass(DT, **arguments)


def test_central_difference_shrinks_a_sine_by_the_sinc():
    omega = 2 * np.pi * 450.0
    time = np.arange(200) * DT
    speed = central_difference(np.sin(omega * time), dt=DT)
    sinc = np.sin(omega * DT) / (omega * DT)
    assert 1 - sinc == pytest.approx(0.0133, abs=1e-4)
    np.testing.assert_allclose(
        speed[1:-1], sinc * omega * np.cos(omega * time[1:-1]), rtol=1e-9, atol=1e-7
    )
    assert np.isnan(speed[[0, -1]]).all()


def test_central_difference_of_columns_is_exact_for_parabolas():
    time = np.arange(9) * 0.5
    speed = central_difference(np.c_[time**2, 3 - time], dt=0.5)
    np.testing.assert_allclose(speed[1:-1], np.c_[2 * time, np.full(9, -1.0)][1:-1])
