"""The figures of the study."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backsight.plot import band, figure, label, line, truth
from backsight.types import Array
from backsight_studies.arrival.evaluate import BAND
from backsight_studies.arrival.expected import NOMINAL, nonlinear
from backsight_studies.arrival.experiment import SHOWN, Experiment
from backsight_studies.arrival.machines import MACHINES
from backsight_studies.arrival.methods import ARRIVALS, CLIPPED, KALMAN, LINEAR, NONE, SMOOTHED
from backsight_studies.arrival.plants import HORIZONS, SPRING
from backsight_studies.panels import axes_by_row, finished, save_all

QUANTITY = {"v": "the speed", "pA": "A's pressure", "mu": "μ", "k3": "k3"}

_WIDTH = 10.0

MARKERS = ("o", "s", "^", "v", "D", "P")


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    figures = {
        "reactor": _reactor(experiment),
        "horizon": _horizon(experiment),
        "bands": _bands(experiment),
    }
    figures |= {f"start_{m.name.lower()}": _machine(experiment, m.name) for m in MACHINES
                if any(c.machine == m.name for c in experiment.machines)}  # fmt: skip
    return save_all(figures, folder)


def _reactor(e: Experiment) -> Figure:
    """Both pressures over time, first recording."""
    made = figure(1, 2, width=_WIDTH, height=3.0)
    shown = {KALMAN: KALMAN, CLIPPED: CLIPPED}
    shown |= {f"{k}, N = {SHOWN}": f"MHE, arrival cost: {k}" for k in (NONE, SMOOTHED)}
    for k, (ax, gas) in enumerate(zip(made.axes, "AB", strict=True)):
        for i, (key, name) in enumerate(shown.items()):
            d = e.drawn[key]
            values = (ax, d["time"], d["x"][:, k])
            if name.endswith(SMOOTHED):
                band(*values, d["std"][:, k], name=name, series=i, deviations=BAND)
            else:
                line(*values, name=name, series=i)
        truth(ax, d["time"], d["truth"][:, k])
        label(ax, f"pressure of {gas}", "atm")
        ax.set_ylim(-4.0, 7.0)
    return finished(made, "time [min]")


def _horizon(e: Experiment) -> Figure:
    """Error over the horizon, all plants; beside it that of the filter alone."""
    made = figure(1, len(e.plants), width=_WIDTH, height=3.2)
    for ax, plant in zip(made.axes, e.plants, strict=True):
        _over_horizon(ax, {k: [e.error(plant.name, k, N) for N in HORIZONS] for k in ARRIVALS})
        alone = e.error(plant.name, LINEAR if plant.name == SPRING else KALMAN, 0)
        truth(ax, np.array(HORIZONS[:: len(HORIZONS) - 1]), np.full(2, alone), name="filter alone")
        ax.set_yscale("log")
        ax.tick_params(axis="y", which="minor", labelsize=8)
        label(ax, f"{plant.name}:\nerror of {QUANTITY[plant.judged]}", plant.unit or "1")
    return finished(made, "horizon N [samples]")


def _bands(e: Experiment) -> Figure:
    """Coverage over the horizon, nonlinear plants."""
    names = nonlinear(e)
    made = figure(1, len(names), width=_WIDTH, height=2.8)
    for ax, name in zip(made.axes, names, strict=True):
        _over_horizon(ax, {k: [100 * e.covered(name, k, N) for N in HORIZONS] for k in ARRIVALS})
        truth(ax, np.array(HORIZONS[::2]), np.full(2, 100 * NOMINAL), name="nominal")
        ax.set_ylim(0.0, 104.0)
        label(ax, f"{name}:\ntruth within {BAND:g} deviations", "%")
    return finished(made, "horizon N [samples]")


def _over_horizon(ax: Axes, series: dict[str, list[float]]) -> None:
    for i, (name, values) in enumerate(series.items()):
        line(ax, np.array(HORIZONS), _finite(values), name=name, series=i)
        ax.lines[-1].set(marker=MARKERS[i], markersize=4)
    ax.set_xscale("log")
    ax.set_xticks(HORIZONS, [str(N) for N in HORIZONS])
    ax.minorticks_off()
    ax.margins(x=0.05)


def _finite(values: list[float]) -> Array:
    found = np.array(values)
    return np.where(np.isfinite(found), found, np.nan)


def _machine(e: Experiment, name: str) -> Figure:
    """Parameters per reference after wrong starts."""
    found = [c for c in e.machines if c.machine == name]
    parameters = list(found[0].time)
    made = figure(1, len(parameters), width=_WIDTH, height=2.6)
    for axes in axes_by_row(made, shared=False):
        for ax, parameter in zip(axes, parameters, strict=True):
            for i, c in enumerate(found):
                drawn = f"{c.label}, start {c.start:g}"
                line(ax, c.series["time"], c.series[parameter], name=drawn, series=i)
            truth(ax, c.series["time"][[0, -1]], np.ones(2), name="reference")
            ax.set_ylim(0.4, 1.6)
            label(ax, f"{parameter} per reference")
    return finished(made, "time [s]")
