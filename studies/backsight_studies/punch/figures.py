"""The figures of the study: 2 to 5 of the paper, and the bias of the damping."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from backsight.plot import figure, label, line, truth
from backsight.types import Array
from backsight_studies.panels import axes_by_row, finished, save_all
from backsight_studies.punch.experiment import Experiment
from backsight_studies.punch.plant import READINGS, STIFF, Reading
from backsight_studies.punch.scenarios import (
    ADAPTIVE,
    AHG,
    EKF,
    EKF1,
    EKF3,
    FAST,
    FIXED,
    GAIN_JUMP,
    JUMPS,
    JUMPS_END,
    STARTS,
    UKF,
    UKF1,
    UKF3,
)
from backsight_studies.punch.tuning import RANGES

QUANTITIES = {"c": "stiffness per truth", "d": "damping per truth", "m": "mass per truth"}
"""In the order of the paper's figures."""

SHOWN = 1.5
"""Seconds of figures 2 and 3."""

_WIDTH, _HEIGHT = 10.0, 2.0


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    far, near = (f"stiff, {s.factor} p" for s in STARTS if s.reading is STIFF)
    figures = {
        "figure2": _starts(experiment, far),
        "figure3": _starts(experiment, near),
        "figure4": _jumps(experiment),
        "figure5": _gain(experiment),
        "bias": _bias(experiment),
    }
    return save_all(figures, folder)


def _starts(e: Experiment, scenario: str) -> Figure:
    """Parameters from a wrong start; the filters as in the paper, and tuned."""
    columns = {"filters with qx = 3": (FAST, EKF3, UKF3), "tuned filters": (FAST, EKF, UKF)}
    made = figure(len(QUANTITIES), len(columns), width=_WIDTH, height=_HEIGHT)
    for (p, quantity), axes in zip(QUANTITIES.items(), axes_by_row(made), strict=True):
        for ax, (name, labels) in zip(axes, columns.items(), strict=True):
            for i, key in enumerate(labels):
                drawn = e.drawn[scenario, key]
                part = drawn["time"] <= SHOWN
                relative = drawn[p][part] / STIFF.truth[p]
                line(ax, drawn["time"][part], relative, name=_short(key), series=i)
            truth(ax, np.array([0.0, SHOWN]), np.ones(2))
            label(ax, f"{quantity}: {name}")
        axes[0].set_ylim(0.0, 2.6)
    return finished(made, "time [s]")


def _jumps(e: Experiment) -> Figure:
    """Parameters while one after the other jumps."""
    labels, times = (AHG, EKF1, EKF, UKF1), np.array([0.0, *(t for t, _ in JUMPS.values())])
    made = figure(len(QUANTITIES), len(READINGS), width=_WIDTH, height=_HEIGHT)
    for (p, quantity), axes in zip(QUANTITIES.items(), axes_by_row(made), strict=True):
        for ax, reading in zip(axes, READINGS, strict=True):
            for i, key in enumerate(labels):
                drawn = e.drawn[f"jumps, {reading.name}", key]
                line(ax, drawn["time"], drawn[p] / reading.truth[p], name=key, series=i)
            at, factor = JUMPS[p]
            steps = np.array([0.0, at, at, JUMPS_END])
            truth(ax, steps, np.array([1.0, 1.0, factor, factor]))
            for time in times[1:]:
                ax.axvline(time, color="0.85", lw=0.8)
            label(ax, f"{quantity}: {reading.name} spring")
        axes[0].set_ylim(0.4, 2.2)
    return finished(made, "time [s]")


def _gain(e: Experiment) -> Figure:
    """Stiffness with fixed and with adaptive gain, and the gain."""
    made = figure(2, len(READINGS), width=_WIDTH, height=_HEIGHT)
    rows = axes_by_row(made, shared=False)
    for k, reading in enumerate(READINGS):
        for i, key in enumerate((FIXED, ADAPTIVE)):
            drawn = e.drawn[f"gain, {reading.name}", key]
            part = drawn["time"] >= 2.5
            time = drawn["time"][part]
            line(rows[0][k], time, _relative(drawn, reading)[part], name=key, series=i)
            line(rows[1][k], time, drawn["lam"][part], name=key, series=i)
        jump = JUMPS["c"][1]
        steps = np.array([2.5, GAIN_JUMP, GAIN_JUMP, time[-1]])
        truth(rows[0][k], steps, np.array([1.0, 1.0, jump, jump]))
        label(rows[0][k], f"stiffness per truth: {reading.name} spring")
        label(rows[1][k], "gain λ", "1/s")
        rows[0][k].set_ylim(0.9, 1.4)
        rows[1][k].set_ylim(0.0, 1.1 * RANGES[reading.name].upper)
    return finished(made, "time [s]")


def _bias(e: Experiment) -> Figure:
    """Error of the damping over the sensor noise."""
    made = figure(1, 1, width=_WIDTH / 2, height=2.6)
    (ax,) = made.axes
    assumed = sorted({b.speed_noise for b in e.biases})
    for i, q in enumerate(assumed):
        found = [b for b in e.biases if b.speed_noise == q]
        noise = np.array([1e6 * b.sensor_noise for b in found])
        error = np.array([100 * b.bias for b in found])
        line(ax, noise, error, name=f"qx = {q:g}", series=i)
        ax.lines[-1].set(marker="o", markersize=4)
    label(ax, "error of the damping, EKF from the truth", "%")
    return finished(made, "sensor noise [µm]")


def _relative(drawn: dict[str, Array], reading: Reading) -> Array:
    return drawn["c"] / reading.truth["c"]


def _short(key: str) -> str:
    return key.split(",")[0]
