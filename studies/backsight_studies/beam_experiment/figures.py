"""The figures of section 5."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from backsight.plot import figure, label, legend, line, truth
from backsight.report.palette import BLACK
from backsight_studies.beam.evaluate import by_window, counts, kept
from backsight_studies.beam.figures import at_nodes
from backsight_studies.beam.plant import DT, N
from backsight_studies.beam.tuning import READING_1, READING_3, THRESHOLD
from backsight_studies.beam_experiment.experiment import NOISE, STEPS, Experiment
from backsight_studies.beam_experiment.plant import FREQUENCIES, SAMPLES, hammer, reference
from backsight_studies.beam_experiment.verdicts import MEASURED
from backsight_studies.panels import save_all

SHOWN_WINDOW = 12
"""The window of Fig. 18."""

SHARES = {"no noise, reading I": (0.0, READING_1), "10 µm, reading III": (NOISE, READING_3)}
"""Name to noise and reading of the recordings that are drawn."""


def draw(e: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    made = {
        "fig16": _hammer(),
        "fig18": _window(e),
        "fig19": _recording(e),
        "fig20": _windows(e),
    }
    return save_all(made, folder)


def _hammer() -> Figure:
    made = figure(width=7.0, height=2.6)
    (ax,) = made.axes
    time = np.linspace(14, 22, 400) * DT
    line(ax, 1e3 * time, hammer(time), name="force of the hammer", series=0)
    steps = np.arange(14, 22)
    middle = 1e3 * DT * (steps + 0.5)
    values = reference()[steps].max(axis=1)
    ax.plot(middle, values, "o", color=BLACK, markersize=4, label="in the middle of every step")
    label(ax, "force", "N", x="time [ms]")
    ax.legend(frameon=False, fontsize=8, loc="upper left")
    return made


def _window(e: Experiment) -> Figure:
    made = figure(1, len(SHARES), width=10.0, height=3.2)
    wanted = by_window(reference(), windows=SHOWN_WINDOW + 1, steps=N)[SHOWN_WINDOW]
    for ax, (name, (sigma, reading)) in zip(made.axes, SHARES.items(), strict=True):
        alpha = e.windows[MEASURED, sigma, reading][0].alpha[SHOWN_WINDOW]
        at_nodes(ax, alpha, wanted, np.arange(N, dtype=np.float64))
        label(ax, f"forces in window {SHOWN_WINDOW}, {name}", "N", x="step in the window")
        legend(ax)
    return made


def _recording(e: Experiment) -> Figure:
    made = figure(len(FREQUENCIES), len(SHARES), width=10.0, height=3.0)
    panels = iter(made.axes)
    for beam in FREQUENCIES:
        for name, (sigma, reading) in SHARES.items():
            ax = next(panels)
            found = e.windows[beam, sigma, reading][0].output
            time = 1e3 * DT * np.arange(len(found), dtype=np.float64)
            at_nodes(ax, kept(found), reference()[: len(found)], time)
            label(ax, f"forces above {THRESHOLD:g} N, {beam}, {name}", "N", x="time [ms]")
            legend(ax)
    return made


def _windows(e: Experiment) -> Figure:
    made = figure(2, 1, width=9.0, height=2.3)
    error, number = made.axes
    for series, (name, (sigma, reading)) in enumerate(SHARES.items()):
        mse = e.mse(MEASURED, sigma, reading)[0]
        windows = np.arange(len(mse), dtype=np.float64)
        line(error, windows, mse, name=name, series=series)
        line(number, windows, e.number(MEASURED, sigma, reading)[0], name=name, series=series)
    true = by_window(reference(), windows=SAMPLES - N, steps=N)
    truth(number, np.arange(len(true), dtype=np.float64), counts(true))
    for ax in made.axes:
        ax.axvline(STEPS[1] + 2 - N, color="0.45", linewidth=0.9, linestyle=":",
                   label="all of the hit has been measured")  # fmt: skip
    label(error, f"MSE of each window, {MEASURED}", "N²")
    label(number, f"forces of at least {THRESHOLD:g} N in the window", x="window")
    legend(error)
    legend(number)
    return made
