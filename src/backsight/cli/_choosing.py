"""Estimators of a problem file by their names."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from backsight.errors import ProblemError, nearest

if TYPE_CHECKING:
    from backsight.estimators.base import AbstractEstimator


def estimator_of(name: str, known: Mapping[str, "AbstractEstimator"]) -> "AbstractEstimator":
    """Look up the estimator of that name.

    Raises
    ------
    ProblemError
        If there is none.
    """
    if name not in known:
        raise ProblemError(f"estimators: there is no '{name}', {nearest(name, known)}")
    return known[name]
