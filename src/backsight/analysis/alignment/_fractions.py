"""A delay with fractions of a sample."""

import math
from collections.abc import Mapping

import numpy as np

from backsight.analysis.alignment.alignment import PARTS
from backsight.types import Array


def vertex(scores: Mapping[float, Array]) -> tuple[float, float] | None:
    """Delay with fractions by Newton's step on the likelihood, and its standard deviation.

    Parameters
    ----------
    scores : dict
        Delays in equal steps of a fraction of a sample to the log-likelihood of every sample.

    Returns
    -------
    (float, float) or None
        None if the likelihood has no maximum inside.
    """
    delays = sorted(scores)
    top = max(range(len(delays)), key=lambda i: float(scores[delays[i]].mean()), default=0)
    if not 0 < top < len(delays) - 1:
        return None
    at, h = delays[top], delays[top + 1] - delays[top]
    before, here, after = (scores[delays[i]] for i in (top - 1, top, top + 1))
    bend = -float((before - 2 * here + after).mean()) / h**2
    slopes = np.array([p.mean() for p in np.array_split((after - before) / (2 * h), PARTS)])
    if not bend > 0:
        return None
    step, std = slopes.mean() / bend, slopes.std(ddof=1) / math.sqrt(PARTS) / bend
    if not std < 0.5:
        return None
    # How sharp the maximum is between the points is not known better than a part of their distance.
    return at + float(step), math.hypot(float(std), 0.1 * h)
