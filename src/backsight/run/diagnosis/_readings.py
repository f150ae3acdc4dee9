"""What readings of sensors look like: angles that start anew, coarse steps, ends of a range."""

import math

import numpy as np
import xarray as xr

from backsight.data.listing import clipped_ends
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.rounding import significant
from backsight.run.estimation import measured_outputs
from backsight.types import Array

TURNS = {"deg": 360.0, "°": 360.0, "rad": 2 * math.pi, "rev": 1.0, "gon": 400.0}
"""A turn by the unit of an angle."""

NEARLY = 0.15
"""A jump is a turn if it lacks no more than this share of it, which the angle moved meanwhile."""

WHOLE = 0.02
"""Readings are in steps if all differences are whole multiples of the smallest one, up to this."""

LEVELS = 5
"""Different readings without which nothing is said of steps."""

LEAST = 20
"""Readings without which nothing is said."""


def turned_readings(model: Model, recording: xr.Dataset) -> list[str]:
    """Say which outputs jump by nearly a turn, although nothing is said of turns."""
    return [
        line
        for s, values in _read(model, recording)
        if s.wrap is None and (line := _turn_of(s, values))
    ]


def clipped_readings(model: Model, recording: xr.Dataset) -> list[str]:
    """Say which outputs stay at the end of a range, although nothing is said of one."""
    lines = []
    for s, values in _read(model, recording):
        found = clipped_ends(values) if s.saturation is None else {}
        if found:
            low, high = (f"{e:.7g}" if e in found else sign for e, sign in _ends_of(values))
            where = " and ".join(f"{n} samples at {e:.7g}" for e, n in found.items())
            lines.append(
                f"output '{s.name}' looks clipped, {where}, and these readings count as measured; "
                f"with saturation = [{low}, {high}] on this output they do not"
            )
    return lines


def _ends_of(values: Array) -> tuple[tuple[float, str], tuple[float, str]]:
    """Both ends of readings, and how no end is written."""
    return (float(values.min()), "-inf"), (float(values.max()), "inf")


def saturated_readings(model: Model, recording: xr.Dataset) -> list[str]:
    """Say of which outputs how many readings do not count since they are at the end of a range."""
    lines = []
    for s in model.outputs:
        if s.saturation is not None and s.dummy is None:
            y = recording["y"].sel(output=s.name).values
            low, high = s.saturation
            left_out = int(np.isfinite(y).sum()) - int(_measured(model, recording, s).sum())
            lines.append(
                f"output '{s.name}': {left_out} of {len(y)} readings are at the ends of its range, "
                f"{low:g} to {high:g}, and count as not measured"
            )
    return lines


def _measured(model: Model, recording: xr.Dataset, output: Signal) -> Array:
    return np.isfinite(measured_outputs(model, recording)[:, model.outputs.index(output)])


def coarse_readings(estimator: AbstractEstimator, model: Model, recording: xr.Dataset) -> list[str]:
    """Say which outputs are rounded more coarsely than the noise that is assumed."""
    sigma = _deviations(estimator, model)
    lines = []
    for s, values in _read(model, recording) if sigma else ():
        step = step_of(values)
        if step / math.sqrt(12) > sigma[s.name]:
            lines.append(
                f"output '{s.name}' is read in steps of {significant(step, 3)}, whose rounding is "
                f"coarser than its noise of {significant(sigma[s.name], 2)}, so that bands are too "
                f"narrow; with resolution = {step:.4g} on this output rounding counts as noise"
            )
    return lines


def rounded_readings(
    estimator: AbstractEstimator, model: Model, recording: xr.Dataset
) -> list[str]:
    """Say of which outputs the rounding counts as noise, and how much that is."""
    sigma = _deviations(estimator, model)
    return [
        f"output '{s.name}': its resolution of {significant(s.resolution, 3)} counts as noise of "
        f"{significant(s.resolution / math.sqrt(12), 2)}; with that of the sensor "
        f"{significant(sigma[s.name], 2)}"
        for s, _ in (_read(model, recording) if sigma else ())
        if s.resolution is not None
    ]


def _read(model: Model, recording: xr.Dataset) -> list[tuple[Signal, Array]]:
    """Outputs that a sensor has, and what it read."""
    y = measured_outputs(model, recording)
    return [(s, y[np.isfinite(y[:, i]), i]) for i, s in enumerate(model.outputs) if s.dummy is None]


def _deviations(estimator: AbstractEstimator, model: Model) -> dict[str, float]:
    """Standard deviation of the noise of every output; empty if the estimator has none."""
    try:
        noise, _ = estimator.assumed
    except TuningError:
        return {}
    sigma = np.sqrt(np.diag(noise.measurement(model, singular=True)))
    return dict(zip([s.name for s in model.outputs], map(float, sigma), strict=True))


def step_of(values: Array) -> float:
    """Step in which readings (n,) come, 0 if they come in none."""
    if len(values) < LEAST:
        return 0.0
    levels = np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * np.ptp(levels)]
    if len(steps) < LEVELS:
        return 0.0
    multiples = steps / steps.min()
    return float(steps.min()) if np.all(np.abs(multiples - np.round(multiples)) < WHOLE) else 0.0


def _turn_of(output: Signal, values: Array) -> str:
    """Sentence on jumps of an output by nearly a turn; empty if there are none."""
    if len(values) < LEAST:
        return ""
    turns = [TURNS[output.unit]] if output.unit in TURNS else []
    turns = turns if output.unit else [360.0, 2 * math.pi]
    moved = np.abs(np.diff(values))
    for turn in turns:
        jumps = int(np.sum(np.abs(moved - turn) < NEARLY * turn))
        within = np.ptp(values) < (1 + NEARLY) * turn
        if jumps and within and np.median(moved) < NEARLY * turn and 4 * jumps < len(moved):
            said = '"2*pi"' if math.isclose(turn, 2 * math.pi) else f"{turn:g}"
            times = "once" if jumps == 1 else f"{jumps} times"
            return (
                f"output '{output.name}' jumps by nearly a turn ({significant(turn, 4)}) {times}, "
                "like an angle that starts anew, and every jump counts as an innovation; with "
                f"wrap = {said} on this output the shortest way round does"
            )
    return ""
