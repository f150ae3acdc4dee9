"""How many samples of a series that hangs together are worth as much as independent ones."""

import numpy as np

from backsight.types import Array


def independent_samples(value: Array) -> float:
    """Samples that count for the mean of `value` (n,).

    By the sum of its autocorrelation up to the first change of sign.
    """
    n = len(value)
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation = value / np.abs(value).max()
    deviation = deviation - deviation.mean()
    power = np.abs(np.fft.rfft(deviation, 2 * n)) ** 2
    covariance = np.fft.irfft(power)[:n]
    if not covariance[0] > 0:
        return float(n)
    correlation = covariance / covariance[0]
    ends = np.flatnonzero(np.asarray(correlation <= 0))
    last = int(ends[0]) if len(ends) else n
    return float(n / (1.0 + 2.0 * correlation[1:last].sum()))
