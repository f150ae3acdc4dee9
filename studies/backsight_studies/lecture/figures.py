"""The figures of the study."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from backsight.plot import figure, label, legend, line, truth
from backsight_studies.lecture.experiment import ALPHAS, BATCH, RECURSIVE, Experiment
from backsight_studies.lecture.plants import DT, FORCE
from backsight_studies.panels import save_all

SHOWN = 60
"""Samples in the figures of the multirate estimates."""

UNSEEN = {"two states": (1, "x2", ""), "two masses": (1, "place of the second mass", "m")}
"""Plant to the state that is not measured: number, name, unit."""


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    made = {
        "batch": _multirate(experiment, BATCH, "batch"),
        "recursive": _multirate(experiment, RECURSIVE, "recursive"),
        "alpha": _alpha(experiment),
        "rounding": _rounding(experiment),
        "increments": _increments(experiment),
        "limits": _limits(experiment),
    }
    return save_all(made, folder)


def _multirate(experiment: Experiment, pairs: tuple[tuple[int, int], ...], form: str) -> Figure:
    made = figure(len(pairs), len(UNSEEN), width=10.0, height=2.6)
    panels = iter(made.axes)
    for m, N in pairs:
        for plant, (i, name, unit) in UNSEEN.items():
            ax, r = next(panels), experiment.multirate[plant, m, N]
            k = np.arange(SHOWN, dtype=float)
            truth(ax, k, r.truth[:SHOWN, i])
            line(ax, k, r.estimates["Kalman filter"][:SHOWN, i], name="Kalman filter", series=0)
            line(ax, k, r.estimates[form][:SHOWN, i], name=f"MHE, {form}", series=1)
            label(ax, f"{name}: m = {m}, N = {N}, {plant}", unit, x="sample")
            legend(ax)
    return made


def _alpha(experiment: Experiment) -> Figure:
    made = figure(1, 2, width=10.0, height=2.8)
    weights = np.array(ALPHAS)
    error, modulus = made.axes
    a = experiment.alpha
    line(error, weights, np.full(len(weights), a.kalman), name="Kalman filter", series=0)
    line(error, weights, a.rmse, name="recursive MHE, started again", series=1)
    label(error, "rms error of the states", x="alpha")
    line(modulus, weights, a.modulus, name="largest eigenvalue of the error", series=1)
    modulus.axhline(1.0, color="0.45", linewidth=0.9, linestyle=":", label="limit of stability")
    label(modulus, "modulus", x="alpha")
    for ax in made.axes:
        legend(ax)
    return made


def _rounding(experiment: Experiment) -> Figure:
    made = figure(width=7.0, height=2.8)
    (ax,) = made.axes
    for series, (name, values) in enumerate(
        {"never started again": experiment.rounding, "every 20 samples": experiment.again}.items()
    ):
        line(
            ax,
            np.arange(len(values), dtype=float),
            np.maximum(values, 1e-17),
            name=name,
            series=series,
        )
    ax.set_yscale("log")
    label(ax, "recursion minus batch, alpha = 1", x="sample")
    legend(ax)
    return made


def _increments(experiment: Experiment) -> Figure:
    made = figure(width=7.0, height=2.8)
    (ax,) = made.axes
    k = np.arange(len(experiment.plain), dtype=float)
    line(ax, k, experiment.plain, name="plain model", series=0)
    line(ax, k, experiment.incremental, name="incremental model", series=1)
    label(ax, "largest error", x="sample")
    legend(ax)
    return made


def _limits(experiment: Experiment) -> Figure:
    made = figure(width=10.0, height=2.8)
    (ax,) = made.axes
    limited = experiment.limited
    time = DT * np.arange(len(limited.truth), dtype=float)
    line(ax, time, limited.free, name="without bounds", series=0)
    line(ax, time, limited.bounded, name=f"bounded by {FORCE:g} N", series=1)
    truth(ax, time, limited.truth)
    label(ax, "force on the second mass", "N", x="time [s]")
    legend(ax)
    return made
