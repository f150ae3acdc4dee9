"""Hits, from unknown forces over time and place."""

import dataclasses
import itertools

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from backsight.description import Printed, checked
from backsight.errors import DataError
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Impact(Printed):
    """One hit.

    Parameters
    ----------
    time : float
        Middle of the force [s]: its centre of gravity over time.
    place : str
        Name of the force.
    impulse : float
        Integral of the force over the hit [unit of the force times s]; its sign is the direction.
    std : float
        Standard deviation of the impulse, of errors that are independent from step to step.
    start, end : float
        First moment at which the force acts and the moment at which it is over [s].
    """

    time: float
    place: str
    impulse: float
    std: float
    start: float
    end: float


@checked(DataError)
def find_impacts(result: xr.Dataset, *, gap: int = 1, ghost: float = 0.0) -> list[Impact]:
    """Join the forces of neighbouring steps into hits.

    A pulse that lasts for several samples, or whose moment falls between two of them, is found as
    several forces in a row. The estimate of one hit may also leak to other places while it lasts.

    Parameters
    ----------
    result : xarray.Dataset
        With the forces ``d_hat (time, force)``, held from one sample to the next, and perhaps their
        ``d_std``; 0 and NaN are no force.
    gap : int
        Steps without force, at the same place, that do not yet end a hit.
    ghost : float
        A hit is left out if it is smaller than this share of one at another place at the same time;
        0 leaves out none.

    Returns
    -------
    list of Impact
        In the order of time.

    Raises
    ------
    DataError
        If the result has no forces, or `gap` or `ghost` is out of range.

    Examples
    --------
    >>> import xarray as xr
    >>> forces = xr.Dataset(
    ...     {"d_hat": (("time", "force"), [[0.0], [2.0], [2.0], [0.0]])},
    ...     {"time": [0.0, 0.1, 0.2, 0.3], "force": ["hit"]},
    ...     {"dt": 0.1},
    ... )
    >>> (hit,) = bs.forces.find_impacts(forces)
    >>> print(f"{hit.place}: {hit.impulse:.1f} N s at {hit.time:.2f} s")
    hit: 0.4 N s at 0.20 s
    """
    if "d_hat" not in result:
        raise DataError(
            "the result has no unknown forces 'd_hat'; use an estimator that finds them"
        )
    if gap < 0 or not 0 <= ghost <= 1:
        raise DataError(f"gap is {gap} and ghost {ghost:g}; give gap >= 0 and ghost from 0 to 1")
    forces = np.nan_to_num(result["d_hat"].values)
    std = np.nan_to_num(result["d_std"].values) if "d_std" in result else np.zeros_like(forces)
    time, dt = result["time"].values, float(result.attrs["dt"])
    places = [str(name) for name in result["force"].values]
    found = [
        _impact(place, time, dt, forces[:, i], std[:, i], run)
        for i, place in enumerate(places)
        for run in _runs(forces[:, i] != 0, gap)
    ]
    kept = [hit for hit in found if not any(_ghost(hit, other, ghost) for other in found)]
    return sorted(kept, key=lambda hit: hit.time)


def _runs(active: NDArray[np.bool_], gap: int) -> list[NDArray[np.intp]]:
    """Steps at which something acts, in groups with at most `gap` empty steps between them."""
    steps = np.flatnonzero(active)
    if not steps.size:
        return []
    return np.split(steps, np.flatnonzero(np.diff(steps) > gap + 1) + 1)


@np.errstate(over="ignore", invalid="ignore")  # of an estimate that diverged, which is told
def _impact(
    place: str, time: Array, dt: float, force: Array, std: Array, run: NDArray[np.intp]
) -> Impact:
    weights = np.abs(force[run])
    return Impact(
        time=float(weights @ (time[run] + dt / 2) / weights.sum()),
        place=place,
        impulse=float(force[run].sum() * dt),
        std=float(np.sqrt((std[run] ** 2).sum()) * dt),
        start=float(time[run[0]]),
        end=float(time[run[-1]] + dt),
    )


def _ghost(hit: Impact, other: Impact, share: float) -> bool:
    elsewhere = hit.place != other.place
    together = hit.start < other.end and other.start < hit.end
    return elsewhere and together and abs(hit.impulse) < share * abs(other.impulse)


@dataclasses.dataclass(frozen=True)
class Matches(Printed):
    """Found hits beside true ones.

    Parameters
    ----------
    pairs : tuple of (int, int)
        Numbers of the true and of the found hit that belong together.
    missed, false : tuple of int
        Numbers of true hits that were not found, and of found ones that are none.
    """

    pairs: tuple[tuple[int, int], ...]
    missed: tuple[int, ...]
    false: tuple[int, ...]


def matches(true: Array, found: Array, *, tolerance: float) -> Matches:
    """Pair true and found times, the closest first, each at most once.

    Parameters
    ----------
    true, found : (n,), (m,) arrays
        Times [s].
    tolerance : float
        Largest distance of a pair [s].
    """
    true, found = np.asarray(true, float), np.asarray(found, float)
    candidates = sorted(
        itertools.product(range(len(true)), range(len(found))),
        key=lambda pair: abs(true[pair[0]] - found[pair[1]]),
    )
    pairs: list[tuple[int, int]] = []
    for i, j in candidates:
        close = abs(true[i] - found[j]) <= tolerance
        if close and all(i != a and j != b for a, b in pairs):
            pairs.append((i, j))
    seen, used = {i for i, _ in pairs}, {j for _, j in pairs}
    return Matches(
        tuple(sorted(pairs)),
        tuple(i for i in range(len(true)) if i not in seen),
        tuple(j for j in range(len(found)) if j not in used),
    )
