"""Distances between an estimate and what is known to be true.

A target of ``NaN`` is "not known" (an output that was not measured) and is left out. An estimate
of ``NaN`` is a failure and makes the distance ``NaN``: a diverged estimator never looks good.
"""

import math

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from backsight.analysis.outliers import taken
from backsight.errors import DataError
from backsight.types import Array


def rse(values: ArrayLike, target: ArrayLike) -> Array:
    r"""Root square error :math:`\|e\| = \sqrt{\sum_k e_k^2}` (eq. 44): a sum, not a mean.

    It grows with the root of the number of samples; compare only equally long recordings.

    Parameters
    ----------
    values : (time, ...) array
        Estimates.
    target : (time, ...) array
        What they should be; samples with ``NaN`` are left out.

    Returns
    -------
    (...) array
        In the unit of `values`; ``NaN`` where no target is known.

    Raises
    ------
    DataError
        If the two have different shapes.

    Notes
    -----
    Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, "Moving horizon observer for vibration dynamics
    with plant uncertainties in nanopositioning system estimation", ACC 2012, eq. 44.
    """
    squares, known = _squares(values, target)
    return np.where(known > 0, np.sqrt(squares), np.nan)


def rmse(values: ArrayLike, target: ArrayLike) -> Array:
    """Root mean square error over the samples with a known target; arguments as in `rse`."""
    squares, known = _squares(values, target)
    return np.where(known > 0, np.sqrt(squares / np.maximum(known, 1)), np.nan)


def rms_innovation(result: xr.Dataset) -> xr.DataArray:
    """Root mean square of the innovation of every output [its unit], (output,).

    Over the measured samples for which the estimator gives an innovation; ``NaN`` if there are
    none.
    """
    e = result["e"].where(taken(result) & np.isfinite(result["e"]))
    with np.errstate(over="ignore"):
        return (e**2).mean("time") ** 0.5


def convergence_time(
    values: ArrayLike, target: ArrayLike, *, band: float, hold: int, time: ArrayLike
) -> float:
    r"""First time from which :math:`|v/v^* - 1|` stays below `band` for `hold` samples.

    Parameters
    ----------
    values : (n,) array
        Estimates of one quantity.
    target : float or (n,) array
        What it should become; not zero.
    band : float
        Allowed relative error, 0.02 for 2 %.
    hold : int
        Number of consecutive samples, the first one included.
    time : (n,) array
        Time of the samples.

    Returns
    -------
    float
        In the unit of `time`; ``NaN`` if it never happens.

    Raises
    ------
    DataError
        If a target is zero, or `hold` is not positive.
    """
    v, goal = np.asarray(values, float), np.asarray(target, float)
    if np.any(goal == 0.0):
        raise DataError("convergence to zero has no relative error: give a target that is not zero")
    if hold < 1:
        raise DataError(f"hold is {hold}; at least one sample must be inside the band")
    inside = np.concatenate([[0], np.cumsum(np.abs(v / goal - 1.0) < band)])
    held = inside[hold:] - inside[:-hold] == hold
    return float(np.asarray(time, float)[np.argmax(held)]) if held.any() else math.nan


def _squares(values: ArrayLike, target: ArrayLike) -> tuple[Array, Array]:
    v, goal = np.asarray(values, float), np.asarray(target, float)
    if v.shape != goal.shape:
        raise DataError(f"the estimates have the shape {v.shape}, their targets {goal.shape}")
    known = ~np.isnan(goal)
    with np.errstate(over="ignore"):
        error = np.where(known, v - goal, 0.0)
        return np.sum(error**2, axis=0), known.sum(axis=0)
