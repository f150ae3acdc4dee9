"""The largest hits among the unknown forces that a result found."""

import dataclasses

import numpy as np
import scipy
import xarray as xr

from backsight.analysis.forces._impacts import Impact, find_impacts
from backsight.description import Printed
from backsight.rounding import plus_minus, significant
from backsight.schema import AGO
from backsight.types import Array

LEVEL = 0.01
"""Probability that chance makes a hit somewhere, where an estimate of the force is never zero."""

TOUCHING = 0
"""Steps without force that do not yet end a hit."""


@dataclasses.dataclass(frozen=True)
class Hit(Printed):
    """A hit with the height of its force.

    Parameters
    ----------
    impact : Impact
        When, where, and its impulse.
    force, std : float
        Largest force during the hit with its standard deviation [unit of the force]; NaN if the
        deviation is unknown.
    position : float or None
        Of the place [m], if the result says so.
    where : str
        Name of the place, with its position if the result says so.
    """

    impact: Impact
    force: float
    std: float
    position: float | None
    where: str


@dataclasses.dataclass(frozen=True)
class FoundHits(Printed):
    """All hits of a result, the largest impulse first; prints itself.

    Parameters
    ----------
    hits : tuple of Hit
    unit : str
        Of the force.
    """

    hits: tuple[Hit, ...]
    unit: str

    def __str__(self) -> str:
        if not self.hits:
            return "no hit found"
        first, unit = self.hits[0], f" {self.unit}" if self.unit else ""
        count = f"{len(self.hits)} hits found, the largest" if len(self.hits) > 1 else "1 hit found"
        return (
            f"{count} at {significant(first.impact.time)} s at {first.where}: "
            f"{plus_minus(first.force, first.std)}{unit}"
        )


def hits(result: xr.Dataset) -> FoundHits | None:
    """Find the hits of a result.

    Forces of neighbouring steps at the same place are one hit, see `find_impacts`. Where an
    estimator gives a force to every sample, those count that chance does not explain (see `LEVEL`).

    Parameters
    ----------
    result : xarray.Dataset
        With or without unknown forces ``d_hat`` (time, force) and their ``d_std``.

    Returns
    -------
    Hits or None
        None if the estimator does not look for forces.
    """
    if "d_hat" not in result:
        return None
    held, std = forces(result)
    acting = result.assign(d_hat=held.copy(data=_beyond_chance(held.values, std.values)), d_std=std)
    labels = dict(zip(map(str, acting["force"].values), where(acting), strict=True))
    found = [_hit(hit, acting, labels[hit.place]) for hit in find_impacts(acting, gap=TOUCHING)]
    found.sort(key=lambda hit: -abs(hit.impact.impulse))
    units = acting["force_unit"].values if "force_unit" in acting.coords else [""]
    return FoundHits(tuple(found), str(units[0]) if len(set(units)) == 1 else "")


def forces(result: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """Return forces (time, force) from each sample to the next and their deviations, 0 if unknown.

    Estimators differ in which interval the force of a sample is about; here it is the one that
    begins with the sample. Forces at the edge that were not estimated are 0.
    """
    held = result["d_hat"]
    std = result["d_std"] if "d_std" in result else xr.zeros_like(held)
    ago = int(held.attrs.get(AGO, 0))
    moved = (v.shift(time=-ago) if ago else v for v in (held, std))
    held, std = (v.copy(data=np.nan_to_num(v.values)) for v in moved)
    return held, std


def _beyond_chance(held: Array, std: Array) -> Array:
    """Forces with those at zero that may be nothing but noise."""
    if not held.size or np.mean(held != 0) < 0.5:
        return held  # the estimator itself has told them apart
    bound = scipy.stats.norm.isf(0.5 * LEVEL / held.size) * std
    return np.where(np.abs(held) > bound, held, 0.0)


def where(result: xr.Dataset) -> list[str]:
    """Name of every place, with its position if the result says so."""
    names = [str(name) for name in result["force"].values]
    if "force_position" not in result.coords:
        return names
    positions = result["force_position"].values
    return [f"{name} ({position:g})" for name, position in zip(names, positions, strict=True)]


def _hit(impact: Impact, acting: xr.Dataset, label: str) -> Hit:
    time, dt = acting["time"].values, float(acting.attrs["dt"])
    # The samples of a hit; rounding of their times does not matter.
    during = np.flatnonzero((time > impact.start - dt / 2) & (time < impact.end - dt / 2))
    at = acting[["d_hat", "d_std"]].sel(force=impact.place).isel(time=during)
    k = int(np.abs(at["d_hat"].values).argmax())
    std = float(at["d_std"].values[k])
    place = at.coords.get("force_position")
    return Hit(
        impact=impact,
        force=float(at["d_hat"].values[k]),
        std=std if std > 0 else np.nan,
        position=None if place is None else float(place),
        where=label,
    )
