"""The figures of the study: those of the paper, the transient, and the weight of the window."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from backsight.plot import figure, label, line, truth
from backsight.types import Array
from backsight_studies.nanopositioner.evaluate import (
    BAND,
    START_UP,
    Measures,
    measured_speed,
    removal,
)
from backsight_studies.nanopositioner.experiment import SCENARIOS, Experiment, Row
from backsight_studies.nanopositioner.tuning import ALPHA, CONVERGED, PAPER_RULE
from backsight_studies.panels import axes_by_row, finished, save_all

COLUMNS = (PAPER_RULE, CONVERGED)
"""Solvers, side by side in every figure."""

SERIES = {"EKF": 0, "MHOa": 1, "MHOb": 2}
"""Method to the number of its colour."""

PARAMETERS = {
    "k": ("k/m", "10⁶ 1/s²", 1e-6),
    "b": ("b/m", "1/s", 1.0),
    "c": ("c/m", "10⁶ µm/s²/V", 1e-6),
    "w": ("force per mass", "10⁵ µm/s²", 1e-5),
}
"""State to quantity, unit and factor."""

SWEPT = {
    "rse_x1": ("RSE x1", "10⁻³ µm", 1e3),
    "rms_v": ("rms of the true speed error", "µm/s", 1.0),
    "std_k": ("std of k/m, settled", "%", 1e2),
    "k_time": ("time until k/m stays within 2 %", "ms", 1.0),
}
"""Measure to quantity, unit and factor."""

_WIDTH = 10.0


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    figures = {
        "figure4": _errors(experiment, "MHOa"),
        "figure5": _parameters(experiment, "MHOa"),
        "figure6": _errors(experiment, "MHOb"),
        "figure7": _parameters(experiment, "MHOb"),
        "transient": _transient(experiment),
    }
    if any(s in SCENARIOS for s in experiment.scenarios):
        figures["alpha"] = _sweep(experiment)
    return save_all(figures, folder)


def _errors(experiment: Experiment, method: str) -> Figure:
    """Figures 4 and 6 of the paper, and the error against the true speed below."""
    stage = experiment.shown.stage
    rows = (
        ("displacement error y − x1", "nm", "q", 1e3 * stage["y"].values[:, 0]),
        ("speed error, eq. 39 − x2", "µm/s", "v", measured_speed(stage)),
        ("speed error, truth − x2", "µm/s", "v", stage["x_true"].sel(state="v").values),
    )
    made = figure(len(rows), len(COLUMNS), width=_WIDTH)
    for row, axes in zip(rows, axes_by_row(made), strict=True):
        quantity, unit, state, target = row
        factor = 1e3 if state == "q" else 1.0
        drawn = []
        for ax, solver in zip(axes, COLUMNS, strict=True):
            for name, variant in _pair(method, solver):
                x = experiment.results[variant]["x_hat"].sel(state=state).values
                error = target - factor * x
                line(ax, _ms(experiment), error, name=name, series=SERIES[name])
                ax.lines[-1].set_linewidth(0.5)
                drawn += [error, -error]
            label(ax, f"{quantity}: {solver}", unit)
            _mark_removal(ax, experiment)
        _zoom(axes, drawn)
    return finished(made, "time [ms]")


def _parameters(experiment: Experiment, method: str) -> Figure:
    """Figures 5 and 7 of the paper."""
    made = figure(len(PARAMETERS), len(COLUMNS), width=_WIDTH)
    for (state, (quantity, unit, factor)), axes in zip(
        PARAMETERS.items(), axes_by_row(made), strict=True
    ):
        true = factor * experiment.shown.stage["x_true"].sel(state=state).values
        drawn = [true]
        for ax, solver in zip(axes, COLUMNS, strict=True):
            for name, variant in _pair(method, solver):
                x = factor * experiment.results[variant]["x_hat"].sel(state=state).values
                line(ax, _ms(experiment), x, name=name, series=SERIES[name])
                drawn.append(x)
            truth(ax, _ms(experiment), true)
            label(ax, f"{quantity}: {solver}", unit)
            _mark_removal(ax, experiment)
        _zoom(axes, drawn)
    return finished(made, "time [ms]")


def _transient(experiment: Experiment) -> Figure:
    """Error of k/m after the removal."""
    true = experiment.shown.stage["x_true"].sel(state="k").values
    since = _ms(experiment) - _ms(experiment)[removal(experiment.shown.stage)]
    part = (since >= -5) & (since <= 60)
    made = figure(1, len(COLUMNS), width=_WIDTH, height=3.0)
    for ax, solver in zip(axes_by_row(made)[0], COLUMNS, strict=True):
        ax.axhspan(-100 * BAND, 100 * BAND, color="0.9", label="2 % band")
        for name, variant in (("EKF", "EKF"), *((m, f"{m}, {solver}") for m in ALPHA)):
            x = experiment.results[variant]["x_hat"].sel(state="k").values
            error = 100 * (x / true - 1)
            line(ax, since[part], error[part], name=name, series=SERIES[name])
        label(ax, f"error of k/m: {solver}", "%")
    return finished(made, "time after the removal [ms]")


def _sweep(experiment: Experiment) -> Figure:
    """Measures over the weight of the window, converged."""
    scenarios = [s for s in SCENARIOS if s in experiment.scenarios]
    made = figure(len(SWEPT), len(scenarios), width=_WIDTH)
    for (field, (quantity, unit, factor)), axes in zip(
        SWEPT.items(), axes_by_row(made), strict=True
    ):
        for ax, scenario in zip(axes, scenarios, strict=True):
            observers, benchmark, name = _swept(experiment, scenario)
            weights = np.array([_weight(r) for r in observers])
            values = np.array([factor * getattr(r.measures, field) for r in observers])
            level = factor * getattr(benchmark, field)
            line(ax, weights, np.full(len(weights), level), name="EKF", series=0)
            line(ax, weights, values, name="MHO, converged", series=1)
            ax.lines[-1].set(marker="o", markersize=4)
            for (method, alpha), style in zip(ALPHA.items(), ("--", ":"), strict=True):
                ax.axvline(alpha, color="0.45", lw=0.9, ls=style, label=f"α of {method}")
            ax.set(xscale="log", yscale="log")
            ax.margins(x=0.02)
            ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ax.yaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_minor_locator(NullLocator())
            label(ax, f"{quantity}: {name}", unit)
    return finished(made, "weight α of the measurements in the window")


def _swept(experiment: Experiment, scenario: str) -> tuple[list[Row], Measures, str]:
    """Converged observers on the first recording of a scenario by weight, the EKF, its name."""
    name = next(r.trial.label for r in experiment.rows if r.trial.scenario == scenario)
    rows = [r for r in experiment.rows if r.trial.label == name]
    observers = [r for r in rows if r.variant.solver == CONVERGED]
    benchmark = next(r.measures for r in rows if r.variant.label == "EKF")
    return sorted(observers, key=_weight), benchmark, name


def _weight(row: Row) -> float:
    return float(getattr(row.variant.estimator, "alpha", np.nan))


def _pair(method: str, solver: str) -> tuple[tuple[str, str], ...]:
    """Name and variant of the benchmark and of one observer."""
    return ("EKF", "EKF"), (method, f"{method}, {solver}")


def _ms(experiment: Experiment) -> Array:
    return 1e3 * experiment.shown.stage["time"].values


def _zoom(axes: list[Axes], drawn: list[Array]) -> None:
    """Show everything but the first samples, whose errors would set the scale."""
    shown = np.concatenate([values[START_UP:] for values in drawn])
    shown = shown[np.isfinite(shown)]
    if len(shown) == 0:
        return
    margin = 0.06 * np.ptp(shown)
    axes[0].set_ylim(np.min(shown) - margin, np.max(shown) + margin)


def _mark_removal(ax: Axes, experiment: Experiment) -> None:
    moment = _ms(experiment)[removal(experiment.shown.stage)]
    ax.axvline(moment, color="0.45", lw=0.9, ls=":", label="payload removed")
