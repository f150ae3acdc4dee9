"""The pseudo-random binary signal."""

import numpy as np
import pytest

from backsight.errors import BacksightError
from backsight.signals import prbs
from backsight.signals.binary import TAPS

FIRST_24 = {
    0: "010000000000100000000101",
    1: "111001000000111010000110",
}
"""First bits for two seeds, from an independent implementation of the 11-bit register."""


@pytest.mark.parametrize("seed", FIRST_24)
def test_first_bits(seed):
    expected = [2.0 * int(bit) - 1.0 for bit in FIRST_24[seed]]
    np.testing.assert_array_equal(prbs(24, seed=seed), expected)


def by_register(n, *, seed, bits):
    """Shift the register itself, one bit at a time."""
    state, out = (37 * seed + 1) % (2**bits - 1) + 1, []
    for _ in range(n):
        out.append(2.0 * (state & 1) - 1.0)
        feedback = state
        for tap in TAPS[bits]:
            feedback ^= state >> (bits - tap)
        state = state >> 1 | (feedback & 1) << (bits - 1)
    return out


@pytest.mark.parametrize("bits", [3, 8, 11, 12, 20])
@pytest.mark.parametrize("seed", [0, 5, 4711])
def test_it_is_the_output_of_the_shift_register(bits, seed):
    np.testing.assert_array_equal(
        prbs(400, seed=seed, bits=bits), by_register(400, seed=seed, bits=bits)
    )


@pytest.mark.parametrize("bits", TAPS)
def test_maximum_length(bits):
    """Over a period, only a maximum-length sequence has the autocorrelation -1 at every lag."""
    period = 2**bits - 1
    spectrum = np.abs(np.fft.fft(prbs(period, seed=3, bits=bits))) ** 2
    np.testing.assert_allclose(spectrum[1:], period + 1, rtol=1e-6)
    np.testing.assert_allclose(spectrum[0], 1, rtol=1e-6)


def test_it_repeats_after_its_period():
    signal = prbs(3 * 31, bits=5)
    np.testing.assert_array_equal(signal[31:], signal[:-31])


def test_bits_are_held_and_scaled():
    held = prbs(23, samples_per_bit=5, amplitude=1.5)
    np.testing.assert_array_equal(held, 1.5 * np.repeat(prbs(5), 5)[:23])
    assert prbs(0).shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n": -1}, "n = -1"),
        ({"n": 5, "seed": -1}, "seed = -1"),
        ({"n": 5, "samples_per_bit": 0}, "samples_per_bit = 0"),
        ({"n": 5, "bits": 2}, "bits = 2; known: 3 to 20"),
    ],
)
def test_arguments_out_of_range(arguments, message):
    with pytest.raises(BacksightError, match=message):
        prbs(**arguments)
