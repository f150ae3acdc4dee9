"""The figures of the study."""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from backsight.plot import figure, label, legend, line
from backsight.report.palette import ON_LIGHT
from backsight_studies.frame_hammer.experiment import Case, Experiment
from backsight_studies.frame_hammer.follow import ADVANCE, LOOK, SAMPLES, Piece
from backsight_studies.frame_hammer.rig import DT, HEIGHTS, SENSORS, STEP
from backsight_studies.frame_hammer.sparse import FORCES
from backsight_studies.frame_hammer.window import Window
from backsight_studies.panels import save_all

MARKS = ("o", "s", "^")

PERCENT = FuncFormatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "125" else "")
"""Of a logarithmic axis: numbers at 1, 2, 5, 10 ... only."""

FORCES_SHOWN = 4.0
"""Length of the force map [s]."""


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    made: dict[str, Figure] = {}
    for case in experiment.measured:
        name = case.recording.name
        made[f"hits_{name}"] = _hits(case)
        struck = [p for p in case.detection.track.pieces if p.pulses]
        if struck:
            made[f"heights_{name}"] = _heights(case)
            made[f"window_{name}"] = _window(case, struck[len(struck) // 2])
        if case.sparse is not None:
            made[f"forces_{name}"] = _forces(case, case.sparse.result)
    made["sizes"] = _sizes(experiment)
    return save_all(made, folder)


def _hits(case: Case) -> Figure:
    made = figure(2, 1, width=10.0, height=2.3)
    top, bottom = made.axes
    time = case.recording.times(np.arange(len(case.recording.y)))
    line(top, time, case.recording.y[:, -1], name=f"sensor at {SENSORS[-1]:.2f} m", series=0)
    label(top, f"{case.recording.name}: what is measured", "m/s²")
    legend(top)
    hammer, found = case.recording.hammer, case.found
    if hammer is not None:
        bottom.vlines(
            hammer.time, 0, hammer.impulse, color="0.55", linewidth=3, label="hammer", zorder=1
        )
    for i, height in enumerate(HEIGHTS):
        here = found.height == height
        bottom.plot(
            found.time[here], np.abs(found.impulse[here]), MARKS[i], color=ON_LIGHT[i],
            markersize=5, label=f"found at {height:.2f} m",
        )  # fmt: skip
    bottom.set_ylim(bottom=0)
    label(bottom, "impulse of the hits", "N s", x="time [s]")
    legend(bottom)
    return made


def _heights(case: Case) -> Figure:
    made = figure(width=10.0, height=2.8)
    (ax,) = made.axes
    hits = case.detection.hits
    time = case.found.time
    for i, height in enumerate(HEIGHTS):
        left = np.array([100 * (1 - hit.shares[i]) for hit in hits])
        ax.plot(time, left, MARKS[i], color=ON_LIGHT[i], markersize=5, label=f"{height:.2f} m")
    nothing = [100 * (1 - hit.without) for hit in hits]
    ax.plot(time, nothing, "x", color="0.4", markersize=5, label="no hit")
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(PERCENT)
    ax.yaxis.set_minor_formatter(PERCENT)
    ax.tick_params(which="minor", labelsize=7, labelcolor="0.4")
    ax.margins(x=0.02, y=0.15)
    name = f"{case.recording.name}: unexplained energy of the window if the hit is at ..."
    label(ax, name, "%", x="time of the hit [s]")
    legend(ax)
    return made


def _window(case: Case, piece: Piece) -> Figure:
    """One window with a hit: readings and model, raw acceleration and limit."""
    axis, window = case.detection.track.axis, Window(case.detection.track.axis, _LONG)
    columns = window.columns(piece.pulses)
    raw = np.tensordot(np.concatenate([piece.fit.modes, piece.fit.hits]), columns, 1)
    y = case.recording.y[piece.start : piece.start + _LONG].T
    model = y - window.residual(y, columns, piece.fit.unknowns)
    made = figure(len(SENSORS), 2, width=10.0, height=1.7)
    coarse = 1e3 * DT * np.arange(_LONG, dtype=float)
    fine = 1e3 * STEP * np.arange(raw.shape[1], dtype=float)
    for j, height in enumerate(SENSORS):
        left, right = made.axes[2 * j : 2 * j + 2]
        last = "time in the window [ms]" if j == len(SENSORS) - 1 else None
        line(left, coarse, y[j], name="measured", series=0)
        line(left, coarse, model[j], name="model", series=1)
        label(left, f"sensor at {height:.2f} m: reading", "m/s²", x=last)
        line(right, fine, raw[j], name="acceleration", series=2)
        for side in (-1, 1):
            right.axhline(
                side * axis.limit, color="0.35", linewidth=0.9, linestyle=":",
                label="limit of the sensor" if side == 1 else None,
            )  # fmt: skip
        label(right, f"at {height:.2f} m: acceleration that was found", "m/s²", x=last)
        for ax in (left, right):
            _mark(ax, piece)
    for ax in made.axes[:2]:
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.35 * (high - low))
        ax.legend(frameon=False, fontsize=8, ncols=4, loc="upper left")
    return made


def _mark(ax: Axes, piece: Piece) -> None:
    ax.axvline(
        1e3 * STEP * piece.pulses[0].middle, color="0.6", linewidth=1.0, zorder=0, label="hit"
    )


def _forces(case: Case, result: xr.Dataset) -> Figure:
    """Unknown forces of the sparse estimator at every height."""
    shown = result["time"].values <= FORCES_SHOWN
    made = figure(len(FORCES), 1, width=10.0, height=1.5)
    largest = 0.1 + 1.1 * float(np.abs(result["d_hat"].sel(force=list(FORCES)).values[shown]).max())
    for i, (ax, (name, height)) in enumerate(zip(made.axes, FORCES.items(), strict=True)):
        force = result["d_hat"].sel(force=name).values[shown]
        line(ax, result["time"].values[shown], force, name="compressive-sensing MHE", series=0)
        if case.recording.hammer is not None:
            for k, moment in enumerate(case.recording.hammer.time):
                if moment <= FORCES_SHOWN:
                    name_once = "hammer" if k == 0 else None
                    ax.axvline(moment, color="0.6", linewidth=0.8, linestyle="--", label=name_once)
        last = "time [s]" if i == len(FORCES) - 1 else None
        label(ax, f"{case.recording.name}: force at {height:.2f} m", "N", x=last)
        ax.set_ylim(-largest, largest)
    legend(made.axes[0])
    return made


def _sizes(experiment: Experiment) -> Figure:
    made = figure(1, 2, width=10.0, height=3.6)
    for ax, cases, title in zip(
        made.axes,
        (experiment.measured, experiment.simulated),
        ("measured", "simulated"),
        strict=True,
    ):
        largest = 0.3
        for i, (name, pairs) in enumerate(_pairs(cases).items()):
            ax.plot(
                pairs[:, 0], pairs[:, 1], MARKS[i % len(MARKS)], color=ON_LIGHT[i % len(ON_LIGHT)],
                markersize=4, label=name,
            )  # fmt: skip
            largest = max(largest, float(pairs.max()))
        ax.plot([0, largest], [0, largest], color="0.5", linewidth=0.9, linestyle=":")
        label(ax, f"{title}: impulse that was found", "N s", x="impulse of the hammer [N s]")
        ax.set_xlim(0, None)
        ax.set_ylim(0, None)
        if ax.get_legend_handles_labels()[0]:
            legend(ax)
    return made


def _pairs(cases: tuple[Case, ...]) -> dict[str, np.ndarray]:
    """Impulses of the hammer and found ones, (n, 2), by recording or by simulated height."""
    rows: dict[str, list[tuple[float, float]]] = {}
    for case in cases:
        hammer, found = case.recording.hammer, case.found
        if hammer is None or not len(found.time):
            continue
        name = case.recording.name.split(", seed")[0]
        for time, impulse in zip(found.time, found.impulse, strict=True):
            nearest = int(np.argmin(np.abs(hammer.time - time)))
            rows.setdefault(name, []).append((float(hammer.impulse[nearest]), abs(impulse)))
    return {name: np.array(pairs) for name, pairs in rows.items()}


_LONG = SAMPLES + ADVANCE + LOOK
