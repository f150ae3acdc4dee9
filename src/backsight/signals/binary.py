"""Pseudo-random binary signals."""

import numpy as np
import scipy

from backsight.errors import BacksightError
from backsight.types import Array

TAPS = {
    3: (2,),
    4: (3,),
    5: (3,),
    6: (5,),
    7: (6,),
    8: (6, 5, 4),
    9: (5,),
    10: (7,),
    11: (9,),
    12: (6, 4, 1),
    13: (4, 3, 1),
    14: (5, 3, 1),
    15: (14,),
    16: (15, 13, 4),
    17: (14,),
    18: (11,),
    19: (6, 2, 1),
    20: (17,),
}
"""Register length n to the exponents between n and 0 of a primitive polynomial: x^11 + x^9 + 1."""


def prbs(
    n: int,
    *,
    seed: int = 0,
    bits: int = 11,
    samples_per_bit: int = 1,
    amplitude: float = 1.0,
) -> Array:
    r"""Pseudo-random binary signal of maximum length.

    A Fibonacci shift register moves right; its least significant bit is the output, and the
    feedback of :math:`x^{11} + x^9 + 1` (`TAPS` for other lengths) enters on the left. It starts at
    :math:`(37\,\mathrm{seed} + 1) \bmod (2^{bits} - 1) + 1`. The sequence repeats after
    :math:`2^{bits} - 1` bits; a seed only chooses where in it the signal begins.

    Parameters
    ----------
    n : int
        Number of samples.
    seed : int
        Not negative.
    bits : int
        Length of the register, 3 to 20.
    samples_per_bit : int
        How long each bit is held; the energy lies below ``1 / (samples_per_bit * dt)``.
    amplitude : float
        The signal is plus or minus this.

    Returns
    -------
    (n,) array

    Raises
    ------
    BacksightError
        If an argument is outside its range.

    Examples
    --------
    >>> prbs(6, amplitude=1.5)
    array([-1.5,  1.5, -1.5, -1.5, -1.5, -1.5])
    """
    if n < 0 or seed < 0 or samples_per_bit < 1:
        raise BacksightError(
            f"prbs: n = {n} and seed = {seed} must not be negative, "
            f"samples_per_bit = {samples_per_bit} must be positive"
        )
    if bits not in TAPS:
        raise BacksightError(f"prbs: bits = {bits}; known: {min(TAPS)} to {max(TAPS)}")
    state = (37 * seed + 1) % (2**bits - 1) + 1
    sequence, _ = scipy.signal.max_len_seq(
        bits,
        state=[state >> k & 1 for k in range(bits)],
        length=-(-n // samples_per_bit),
        # SciPy counts taps from the end at which the bits leave.
        taps=sorted(bits - t for t in TAPS[bits]),
    )
    return amplitude * np.repeat(2.0 * sequence - 1.0, samples_per_bit)[:n]
