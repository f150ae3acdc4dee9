r"""How a measured output compares with a model's response to the recorded input: size and sign.

Both are taken to the frequency domain, :math:`G(f) = S_{my}(f) / S_{mm}(f)` with `m` for the
model and `y` for the measurement, at the frequencies at which they are coherent. Resonances at
other places, drifts and unknown forces spoil some frequencies; the median over all of them is what
a wrong unit or a wrong sign changes.

Source: Bendat, Piersol, "Random Data", Wiley 2010, chapters 6 and 9,
https://doi.org/10.1002/9781118032428.
"""

import dataclasses
import math

import numpy as np

from backsight.description import Printed
from backsight.rounding import significant
from backsight.types import Array

COHERENT = 0.8
"""Coherence from which on a frequency counts."""

LEAST_FREQUENCIES = 6
"""Coherent frequencies without which nothing is said."""

PLAUSIBLE = 4.0
"""Ratios up to this, and down to its inverse, may come from parameters that are not yet known."""

HUGE = 1e100
"""A response beyond this is that of a model that does not stay finite."""

KNOWN = {
    2 * math.pi: "2π",
    9.81: "the acceleration of gravity",
    25.4: "inch and millimetre",
    180 / math.pi: "degree and radian",
    60.0: "minute and second",
    100.0: "per cent, or centi",
    1e3: "milli or kilo",
    1e6: "micro or mega",
}
"""Factors between units that are mistaken for each other."""

ALIKE, ALIKE_IF_LARGE, LARGE = 1.6, 3.0, 200.0
"""How far a ratio may be from a known factor, and from one that has no neighbours."""


@dataclasses.dataclass(frozen=True)
class Ratio(Printed):
    """Measured output per response of the model.

    Parameters
    ----------
    output : str
    size : float
        Median over the coherent frequencies; NaN if there are too few.
    direction : float
        Mean cosine of the phase between the two: 1 if they agree, -1 if the sign is wrong.
    frequencies : int
        Number of coherent frequencies.
    """

    output: str
    size: float
    direction: float
    frequencies: int

    @property
    def known(self) -> bool:
        """Whether anything can be said."""
        return self.frequencies >= LEAST_FREQUENCIES

    @property
    def factor(self) -> float:
        """What to divide the measured output by; 1 if nothing is certainly wrong."""
        if not self.known:
            return 1.0
        sign = -1.0 if self.direction < -0.5 else 1.0
        if 1 / PLAUSIBLE < self.size < PLAUSIBLE:
            return sign
        near = _near(self.size)
        return sign * (near[0] if near else self.size)

    def sentence(self) -> str:
        """Say what is wrong and how to mend it; empty if nothing is."""
        factor = self.factor
        if factor == 1.0:
            return ""
        if factor == -1.0:
            return (
                f"the measured '{self.output}' has the opposite sign of the model's response to "
                "the input; turn the sign of one of them round (factor = -1)"
            )
        compared = "larger" if self.size > 1 else "smaller"
        times = significant(max(self.size, 1 / self.size), 2)
        sign = " and of opposite sign" if factor < 0 else ""
        names = " or ".join(KNOWN[max(k, 1 / k)] for k in _near(self.size))
        return (
            f"the measured '{self.output}' is about {times} times {compared} than the model's "
            f"response to the input{sign}{f' ({names}?)' if names else ''}; check the units of "
            f"'{self.output}' and of the inputs, and give the factor between them"
        )


def ratio(output: str, measured: Array, response: Array) -> Ratio:
    """Compare two signals (n,); NaN in the measured one is interpolated."""
    known = np.isfinite(measured)
    if known.sum() < 0.05 * len(measured) or not (np.abs(response) < HUGE).all():
        return Ratio(output, math.nan, math.nan, 0)
    places = np.arange(len(measured))
    filled = np.interp(places, places[known], measured[known])
    if len(filled) < 64 or not (np.ptp(filled) > 0 and np.ptp(response) > 0):
        return Ratio(output, math.nan, math.nan, 0)
    Y, M = _spectra(filled), _spectra(response)
    cross = (np.conj(M) * Y).mean(axis=0)
    power, other = (np.abs(M) ** 2).mean(axis=0), (np.abs(Y) ** 2).mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        coherent = np.abs(cross) ** 2 > COHERENT * power * other
    coherent &= (power > 0) & (other > 0)
    coherent[:2] = False
    if coherent.sum() < LEAST_FREQUENCIES:
        return Ratio(output, math.nan, math.nan, int(coherent.sum()))
    G = cross[coherent] / power[coherent]
    size, direction = float(np.median(np.abs(G))), float(np.mean(np.cos(np.angle(G))))
    return Ratio(output, size, direction, int(coherent.sum()))


def _spectra(x: Array) -> np.ndarray:
    """Spectra of overlapping parts without their trends, (parts, frequencies)."""
    length = max(64, len(x) // 16)
    starts = range(0, len(x) - length + 1, length // 2)
    parts = np.array([x[s : s + length] for s in starts])
    ramp = np.linspace(-1.0, 1.0, length)
    parts = parts - parts.mean(axis=1, keepdims=True)
    parts = parts - np.outer(parts @ ramp / (ramp @ ramp), ramp)
    return np.fft.rfft(parts * np.hanning(length), axis=1)


def _near(size: float) -> list[float]:
    """Return the known factors, or their inverses, that may be meant, the nearest first."""
    power = 1.0 if size > 1 else -1.0
    off = {k**power: abs(math.log(size / k**power)) for k in KNOWN}
    widest = {k**power: math.log(ALIKE_IF_LARGE if k > LARGE else ALIKE) for k in KNOWN}
    return sorted((k for k in off if off[k] < widest[k]), key=lambda k: off[k])
