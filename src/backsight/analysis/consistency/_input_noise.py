r"""Whether innovations follow the noise of a measured input, rather than its motion.

A model that answers its input wrongly makes innovations that follow the input as a whole. Noise of
a measured input has not moved the machine: innovations follow only what is new in the input, the
difference between a sample and its interpolation from those around it. Jumps, which are new, too,
are cut at `WIDEST` deviations. An input that cannot be interpolated (white by intention) tells
nothing. One that a controller makes from the output looks the same as noise: the samples that come
later, from which it is interpolated, know of the innovation then.

The noise must show within `DELAYS` samples: what it has moved slowly is not in what is new. That
nothing is found therefore does not mean that there is none.

The interpolation from all other samples leaves a multiple of the inverse-filtered signal, see
Kolmogorov, "Interpolation and extrapolation of stationary random sequences", 1941; the problem is
that of errors in variables, Soderstrom, "Errors-in-variables methods in system identification",
Automatica 43(6), 2007, https://doi.org/10.1016/j.automatica.2006.11.025.
"""

import dataclasses
import math

import numpy as np
import scipy

from backsight.analysis.consistency._projection import orthonormal, without
from backsight.description import Printed
from backsight.types import Array

AROUND = 5
"""Samples on either side from which one is interpolated."""

DELAYS = 10
"""Samples back from which noise of an input is looked for."""

MOST = 20_000
"""Samples that suffice: the last ones are taken."""

WIDEST = 4.0
"""Deviations at which what is new in an input is cut."""


@dataclasses.dataclass(frozen=True)
class NoiseOfInputs(Printed):
    """What the unpredictable part of the inputs explains of the innovations of one output.

    Parameters
    ----------
    share : float
        Share of their variance; NaN if it cannot be told.
    p : float
        Probability of at least such a share by chance.
    input : int
        The input that explains most.
    """

    share: float
    p: float
    input: int


UNKNOWN = NoiseOfInputs(math.nan, math.nan, 0)


def noise_of_inputs(e: Array, u: Array, memory: int) -> NoiseOfInputs:
    """Ask whether innovations follow what is new in the inputs.

    Parameters
    ----------
    e : (n,) array
        Innovations of one output, NaN where it was not measured.
    u : (n, nu) array
    memory : int
        Innovations before a sample that may explain its own.
    """
    e, u = e[-MOST:], u[-MOST:]
    n, nu = u.shape
    first = max(DELAYS, memory) + AROUND
    inside = np.isfinite(e[first : n - AROUND]) if n > first + AROUND else np.empty(0, bool)
    rows = np.flatnonzero(inside) + first
    if nu == 0 or len(rows) < 20 * DELAYS * (nu + 1):
        return UNKNOWN
    past = np.nan_to_num(e)
    own = np.column_stack([past[rows - lag] for lag in range(1, memory + 1)])
    z = without(own, e[rows])
    new = np.column_stack([_new(u[:, j]) for j in range(nu)])
    each = [
        _share(z, own, np.column_stack([new[rows - lag, j] for lag in range(1, DELAYS + 1)]))[0]
        for j in range(nu)
    ]
    every = np.column_stack([new[rows - lag] for lag in range(1, DELAYS + 1)])
    share, p = _share(z, own, every)
    return NoiseOfInputs(share, p, int(np.argmax(each)))


def _new(v: Array) -> Array:
    """Difference between samples (n,) and their interpolation, zero at both ends, jumps cut."""
    n, inner = len(v), slice(AROUND, len(v) - AROUND)
    lags = [lag for lag in range(-AROUND, AROUND + 1) if lag]
    others = np.column_stack([(v - v.mean())[AROUND + lag : n - AROUND + lag] for lag in lags])
    new = np.zeros(n)
    new[inner] = without(others, (v - v.mean())[inner])
    size = 1.4826 * float(np.median(np.abs(new[inner])))
    return np.clip(new, -WIDEST * size, WIDEST * size)


def _share(z: Array, own: Array, columns: Array) -> tuple[float, float]:
    """Share of z that columns explain beyond what they owe to `own`, and its probability."""
    basis, total = orthonormal(without(own, columns)), float(z @ z)
    if basis.shape[1] == 0 or total == 0:
        return 0.0, 1.0
    share = float(np.sum((basis.T @ z) ** 2)) / total
    left = len(z) - own.shape[1] - basis.shape[1]
    return share, float(scipy.special.betaincc(0.5 * basis.shape[1], 0.5 * left, min(share, 1.0)))
