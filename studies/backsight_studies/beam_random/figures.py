"""The figures of the study."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from backsight.plot import figure, label
from backsight.report.palette import ON_LIGHT
from backsight_studies.beam.plant import THICKNESS
from backsight_studies.beam_random.experiment import Experiment
from backsight_studies.beam_random.scenarios import (
    CALIBRATED,
    GATED,
    L0,
    L1_WINDOW,
    PAPER,
    REWEIGHTED,
)
from backsight_studies.panels import finished, save_all

SHOWN = (PAPER, L1_WINDOW, GATED, REWEIGHTED + CALIBRATED, L0, L0 + CALIBRATED)
MARKERS = "osvD^P"

FIELDS = {
    "f1": "F1, right step and place",
    "false_alarms": "false alarms per recording",
    "magnitude": "relative error of the sizes",
}


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    made = {"methods": _methods(experiment), "frequencies": _frequencies(experiment)}
    return save_all(made, folder)


def _methods(e: Experiment) -> Figure:
    made = figure(1, len(FIELDS), width=11.5, height=3.2)
    mismatches = [-m for m in THICKNESS]
    for ax, (field, name) in zip(made.axes, FIELDS.items(), strict=True):
        for i, method in enumerate(SHOWN):
            values = [e.mean(method, m, field) for m in THICKNESS]
            ax.plot(mismatches, values, marker=MARKERS[i], color=ON_LIGHT[i], markersize=5,
                    linewidth=1.2, label=method)  # fmt: skip
        label(ax, name)
        ax.set_ylim(bottom=0)
        ax.margins(x=0.05)
    return finished(made, "frequencies of the model too low by [%]")


def _frequencies(e: Experiment) -> Figure:
    made = figure(1, len(THICKNESS), width=11.5, height=2.8)
    for ax, (m, errors) in zip(made.axes, e.detuning.items(), strict=True):
        for mode, values in enumerate(100 * errors.T):
            scatter = np.linspace(-0.25, 0.25, len(values)) if len(values) > 1 else np.zeros(1)
            ax.plot(mode + 1 + scatter, values, MARKERS[mode], color=ON_LIGHT[mode], markersize=3,
                    label=f"mode {mode + 1}, calibrated")  # fmt: skip
        ax.axhline(m, color="0.45", linewidth=0.9, linestyle=":", label="before")
        label(ax, f"model {m:g} %: frequency error [%]")
        ax.set_xticks(range(1, errors.shape[1] + 1))
        ax.margins(x=0.05)
    return finished(made, "mode")
