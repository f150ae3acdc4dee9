"""Pulses that were fitted, as a table of hits in physical units with standard deviations."""

import numpy as np
import xarray as xr

from backsight.estimators.dictionaries import AbstractPulses, MovingLoads
from backsight.sparse.pulses.pulse_fit import PulseDrawing, PulseFit
from backsight.types import Array


def hit_table(fit: PulseFit, drawn: PulseDrawing, dt: float, begin: float) -> xr.Dataset:
    """What `locate_hits` returns."""
    rows = [_row(fit, i, drawn, dt, begin) for i in range(len(fit.pulses))]
    rows.sort(key=lambda row: row["time"])
    return xr.Dataset({name: ("hit", np.array([row[name] for row in rows])) for name in rows[0]})


def _row(fit: PulseFit, i: int, drawn: PulseDrawing, dt: float, begin: float) -> dict[str, float]:
    """One hit, its standard deviations by the derivatives of what is shown."""
    own = fit.covariance[i, :, i, :]
    z = np.array([fit.sizes[i], *fit.pulses[i].variables])
    shown, changes = _shown(z, drawn, dt, begin), {}
    for k in range(4):
        step = 1e-5 * max(1.0, abs(z[k]))
        higher = _shown(z + step * np.eye(4)[k], drawn, dt, begin)
        changes[k] = {name: (higher[name] - shown[name]) / step for name in shown}
    row = dict(shown)
    for name in shown:
        slope = np.array([changes[k][name] for k in range(4)])
        row[f"{name}_std"] = float(np.sqrt(max(slope @ own @ slope, 0.0)))
    return row


def _shown(z: Array, drawn: PulseDrawing, dt: float, begin: float) -> dict[str, float]:
    """Place, time and so on of a pulse, physical, of its variables (size, place, start, width)."""
    size, place, start, width = map(float, z)
    match drawn.course:
        case MovingLoads():
            first, last = drawn.line.ends if width > 0 else drawn.line.ends[::-1]
            crossing = abs(width)
            return {
                "place": first,
                "time": begin + dt * (start + crossing / 2),
                "start": begin + dt * start,
                "size": size,
                "impulse": size * crossing * dt,
                "width": crossing * dt,
                "speed": (last - first) / (crossing * dt),
            }
        case AbstractPulses() as course:
            area = width * float(course.impulse(np.array(float(course.lasts))))
            return {
                "place": place,
                "time": begin + dt * course.middle(start=start, width=width),
                "start": begin + dt * start,
                "size": size,
                "impulse": size * area * dt,
                "width": width * dt,
            }
