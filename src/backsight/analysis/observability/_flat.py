"""Directions of the parameters that measurements hardly determine better than the prior does."""

from collections.abc import Sequence

import numpy as np

from backsight.analysis.observability._combinations import combinations
from backsight.models.signals import Signal
from backsight.rounding import significant
from backsight.types import Array

FLAT = 0.7
"""Standard deviation per that of the prior from which on the data have said hardly anything."""

SMALL = 0.2
"""Share of the largest entry of a direction below which a parameter is not named in it."""


def flat_directions(P: Array, prior: Array, parameters: Sequence[Signal]) -> tuple[str, ...]:
    """Say which parameters, or combinations of them, are hardly known better than before.

    The eigenvectors of the covariance, in units of the prior, whose standard deviation is more than
    `FLAT`.

    Parameters
    ----------
    P : (n, n) array
        Covariance of the parameters after the measurements.
    prior : (n,) array
        Standard deviations before them; with one of zero a parameter is not asked for.
    parameters : sequence of Signal

    Returns
    -------
    tuple of str
        A sentence each, without a full stop.
    """
    asked = np.flatnonzero(prior > 0).tolist()
    size, of = prior[asked], [parameters[i] for i in asked]
    relative = P[np.ix_(asked, asked)] / np.outer(size, size)
    if not (asked and np.isfinite(relative).all()):
        return ()
    values, vectors = np.linalg.eigh(relative)
    basis = vectors[:, values > FLAT**2]
    if not basis.shape[1]:
        return ()
    std = size * np.sqrt(np.diag(relative))
    after = {s.name: (v, w) for s, v, w in zip(of, std, size, strict=True)}
    return tuple(
        _alone(text, *after[text]) if text in after else _together(text)
        for text in combinations(basis, of, size, negligible=SMALL)
    )


def _alone(name: str, after: float, before: float) -> str:
    return (
        f"the recording says hardly more of {name} than the prior does "
        f"(± {significant(after, 2)} after ± {significant(before, 2)})"
    )


def _together(named: str) -> str:
    return f"the recording hardly shows a change of {named}: only another combination is known"
