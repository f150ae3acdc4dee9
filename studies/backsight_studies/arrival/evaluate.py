"""Measures of an estimate whose truth is known."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.analysis.consistency import coverage
from backsight.schema import Status
from backsight.types import Array
from backsight_studies.arrival.plants import Plant

BAND = 2.0
"""Half width of the bands whose coverage is told [standard deviations]."""

NEAR = 0.1
"""Largest error of a pressure at the end of the right optimum [atm], the noise of the sensor."""


@dataclasses.dataclass(frozen=True)
class Measures:
    """One estimator on one recording; the second half counts, unless said otherwise.

    Parameters
    ----------
    error : float
        Root mean square error of the judged state; infinite if the estimate was not finite.
    last : float
        Largest error of a state at the last sample, in its unit.
    negative : bool
        Whether a state that cannot be negative is so at the last sample.
    covered : dict
        State to the share of all samples at which the truth lies within `BAND` deviations.
    lost : bool
        Whether the error is larger than the prior's deviation: worse than not to measure.
    open_ : float
        Share of all samples at which the optimiser did not finish.
    """

    error: float
    last: float
    negative: bool
    covered: dict[str, float]
    lost: bool
    open_: float


def measure(plant: Plant, result: xr.Dataset) -> Measures:
    """Compare an estimate with the truth that its recording holds."""
    off = errors(result)
    status = result["status"].values
    finite = np.isfinite(off).all() and not (status & Status.NOT_FINITE).any()
    half = off[len(off) // 2 :, plant.model.index(plant.judged)]
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.sqrt(np.mean(half**2))) if finite else np.inf
    lower = np.array([s.lower for s in plant.model.states])
    return Measures(
        error=error,
        last=float(np.abs(off[-1]).max()) if finite else np.inf,
        negative=bool((result["x_hat"].values[-1] < lower - 1e-9).any()),
        covered=_covered(result),
        lost=not error <= plant.spread,
        open_=float(np.mean((status & Status.ITERATION_LIMIT) > 0)),
    )


def errors(result: xr.Dataset) -> Array:
    """Estimate minus truth, (time, state)."""
    return (result["x_hat"] - result["x_true"]).transpose("time", "state").values


def from_filter(result: xr.Dataset, reference: xr.Dataset) -> float:
    """Largest distance of two estimates, in standard deviations of the second."""
    std = reference["x_std"].values
    off = np.abs(result["x_hat"].values - reference["x_hat"].values)
    return float(np.max(off / np.where(std > 0, std, np.inf)))


def right(measures: Measures) -> bool:
    """Whether the estimate ends in the optimum that is the truth."""
    return measures.last <= NEAR and not measures.negative


def typical(values: Sequence[float]) -> float:
    """Median over the recordings; infinite if half of them are."""
    ordered = np.sort(np.asarray(values, float))
    low, high = ordered[(len(ordered) - 1) // 2], ordered[len(ordered) // 2]
    return float(low if low == high else (low + high) / 2)


def _covered(result: xr.Dataset) -> dict[str, float]:
    with np.errstate(over="ignore", invalid="ignore"):
        shares = coverage(result).sel(deviations=BAND)
    return {
        str(name): float(share)
        for name, share in zip(shares["state"].values, shares.values, strict=True)
    }
