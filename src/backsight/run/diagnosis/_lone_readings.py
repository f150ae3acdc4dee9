"""Readings that are alone: outliers that were believed."""

import numpy as np
import xarray as xr

from backsight.estimators.base import AbstractEstimator
from backsight.rounding import significant
from backsight.schema import Status
from backsight.types import Array

FAR = 12.0
"""Deviations of an innovation from which on it is none of its normal distribution."""

ALONE = 5.0
"""By how much a reading must be further from its neighbours than these are from each other."""

FEW = 0.02
"""Share of the samples from which on such readings are no exceptions, but the signal."""


def lone_readings(estimator: AbstractEstimator, result: xr.Dataset) -> list[str]:
    """Say which outputs have readings that are far from the prediction and from their neighbours.

    Of estimators that believe all readings. Whatever is constant has then learned from them, with
    bands that do not know of it; noise that is blamed for the innovations is not to blame.
    """
    if estimator.outliers is not None or "S" not in result:
        return []
    e, y = result["e"].values, result["y"].values
    spread = np.sqrt(np.maximum(np.einsum("kii->ki", result["S"].values), 0.0))
    with np.errstate(all="ignore"):
        sizes = np.abs(e) / spread
    lines = []
    for i, name in enumerate(result["output"].values):
        found = np.flatnonzero((sizes[:, i] > FAR) & _alone(y[:, i]))
        if 0 < len(found) <= max(1, FEW * len(y)):
            worst, first = float(np.nanmax(sizes[found, i])), float(result["time"][found[0]])
            lines.append(
                f"'{name}' has {_counted(len(found))} up to {significant(min(worst, 1e300), 2)} "
                "standard deviations from the prediction and unlike the readings around it, first "
                f"at t = {first:g} s: an outlier that was believed, and bands are too narrow from "
                "there on; "
                'give the noise a rule for outliers, Gate() (outliers.kind = "gate")'
            )
    return lines


def misled_constants(result: xr.Dataset) -> list[str]:
    """Say from when on constants are worthless, see `backsight.estimators.around.misled`."""
    told = np.flatnonzero(result["status"].values.astype(int) & int(Status.MISLED))
    if not len(told):
        return []
    moment = float(result["time"][told[0]])
    return [
        f"from t = {moment:g} s on its constants are worthless: they have learned from a reading "
        "that cannot be; give the noise a rule for outliers, or let it start anew (restart)"
    ]


def _alone(y: Array) -> Array:
    """Whether a reading (n,) is far from its neighbours, which are near each other."""
    found = np.zeros(len(y), dtype=bool)
    if len(y) < 3:
        return found
    with np.errstate(all="ignore"):
        off, apart = y[1:-1] - (y[:-2] + y[2:]) / 2, y[2:] - y[:-2]
        usual = np.nanmedian(np.abs(off)) if np.isfinite(off).any() else 0.0
        found[1:-1] = (np.abs(off) > ALONE * np.abs(apart)) & (np.abs(off) > ALONE * usual)
    return found


def _counted(n: int) -> str:
    return "a reading" if n == 1 else f"{n} readings"
