"""Hits that were followed, as a table in physical units with standard deviations."""

import itertools
from collections.abc import Sequence

import numpy as np
import xarray as xr

from backsight.estimators.dictionaries import AbstractPulses
from backsight.sparse.nonlinear import FoundHit


def followed_hits(
    found: Sequence[FoundHit],
    course: AbstractPulses,
    forces: Sequence[str],
    beside: Sequence[str],
    *,
    begin: float,
    dt: float,
) -> xr.Dataset:
    """What `follow_hits` returns."""
    numbers = ("time", "start", "size", "impulse", "width")
    names = [*itertools.chain(*((n, f"{n}_std") for n in numbers)), "explained", "rival"]
    columns: dict[str, list[float]] = {name: [] for name in names}
    for hit in found:
        for name, value in _row(hit, course, begin, dt).items():
            columns[name].append(value)
    pulses = [hit.fit.hit for hit in found if hit.fit.hit is not None]
    table = xr.Dataset({name: ("hit", np.array(values)) for name, values in columns.items()})
    table["force"] = "hit", np.array([forces[p.force] for p in pulses], dtype=object)
    sizes = np.array([p.sizes[1:] for p in pulses]).reshape(len(pulses), len(beside))
    table["beside"] = ("hit", "moved"), sizes
    return table.assign_coords(moved=list(beside))


def _row(hit: FoundHit, course: AbstractPulses, begin: float, dt: float) -> dict[str, float]:
    pulse = hit.fit.hit
    assert pulse is not None
    area = float(course.impulse(np.array(float(course.lasts))))
    size, width = pulse.sizes[0], pulse.width
    first = hit.begin + pulse.start
    middle = course.middle(start=0.0, width=1.0)
    nx = len(hit.fit.x0)
    which = [nx, -2, -1]
    spread = hit.covariance[np.ix_(which, which)]  # size, start, width
    shown = {
        "time": (begin + dt * (first + middle * width), (0.0, dt, dt * middle)),
        "start": (begin + dt * first, (0.0, dt, 0.0)),
        "size": (size, (1.0, 0.0, 0.0)),
        "impulse": (size * area * width * dt, (area * width * dt, 0.0, area * size * dt)),
        "width": (width * dt, (0.0, 0.0, dt)),
    }
    row = {name: value for name, (value, _) in shown.items()}
    for name, (_, by) in shown.items():
        row[f"{name}_std"] = float(np.sqrt(max(np.array(by) @ spread @ np.array(by), 0.0)))
    row["explained"] = 1 - hit.fit.cost / hit.without
    row["rival"] = hit.rival / hit.fit.cost
    return row
