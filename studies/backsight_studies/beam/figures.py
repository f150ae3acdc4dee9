"""The figures of the paper: observability, weights, windows, whole recordings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backsight.plot import band, figure, label, legend, line, truth
from backsight.report.palette import BLACK, BLUE, ORANGE, VERMILLION
from backsight.types import Array
from backsight_studies.beam.claims import TABLE_3, WORST, noise_name
from backsight_studies.beam.evaluate import amplitude_rule, by_window, counts, kept, window_mse
from backsight_studies.beam.experiment import SHOWN_WINDOW, SWEPT, Experiment
from backsight_studies.beam.plant import DT, NODES, THICKNESS, N, forces
from backsight_studies.beam.sweeps import Q_EXPONENTS, R_EXPONENTS
from backsight_studies.beam.tuning import EPS_R, READING_1, TABLE, THRESHOLD
from backsight_studies.panels import axes_by_row, finished, save_all

MISTAKEN_WINDOW = 45
"""The window of Fig. 12."""


def draw(experiment: Experiment, folder: Path) -> dict[str, Path]:
    """Write all figures as PNG; returns name to file."""
    made = {
        "fig5": _ranks(experiment),
        "fig6": _weights(experiment),
        "fig7_8": _maps(experiment),
        "fig9": _window(experiment),
        "fig10": _recording(experiment),
        "fig11": _windows(experiment),
        "fig12": _mistaken_window(experiment),
        "fig13": _mistaken_recording(experiment),
    }
    return save_all(made, folder)


def _ranks(e: Experiment) -> Figure:
    made = figure(width=7.0, height=2.8)
    (ax,) = made.axes
    states = e.locations["states"].values.astype(float)
    truth(ax, states, states, name="rank = number of states: observable")
    for series, (order, name) in enumerate(
        {"forward": "from the root to the tip", "backward": "from the tip to the root"}.items()
    ):
        ranks = e.locations["rank"].sel(order=order).values
        line(ax, states, ranks, name=f"forces added {name}", series=series)
    ax.lines[-1].set_linestyle((0, (2, 3)))
    label(ax, "rank of the observability matrix", x="states: 6, and one per random-walk force")
    ax.legend(frameon=False, fontsize=8, loc="upper left")
    return made


def _weights(e: Experiment) -> Figure:
    made = figure(1, len(SWEPT), width=10.0, height=3.2)
    for ax, mismatch in zip(made.axes, SWEPT, strict=True):
        curves = {sigma: curve for (m, sigma), curve in e.curves.items() if m == mismatch}
        for series, (sigma, curve) in enumerate(curves.items()):
            line(ax, curve.lam, curve.mse, name=noise_name(sigma), series=series)
            ax.plot(curve.best, curve.mse.min(), "o", color=BLACK, markersize=4,
                    label="least error" if series == 0 else "_")  # fmt: skip
        ax.axvline(
            TABLE[mismatch].lam, color="0.45", linewidth=0.9, linestyle=":", label="λ of Table 3"
        )
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.margins(0.03, 0.05)
        label(ax, f"MSE of the forces, mismatch {mismatch:g} %", "N²")
    return finished(made, "λ [1/N]")


def _maps(e: Experiment) -> Figure:
    made = figure(2, len(THICKNESS), width=11.0, height=2.9)
    R, Q = (
        np.exp(_edges(exponents)) * unit
        for exponents, unit in ((R_EXPONENTS, 1e-10), (Q_EXPONENTS, 1e-2))
    )
    above, below = axes_by_row(made)
    for m, ax, under in zip(THICKNESS, above, below, strict=True):
        for axes, values in ((ax, e.maps[m].mse), (under, e.maps[m].lam)):
            shades = axes.pcolormesh(R, Q, np.log10(values), cmap="cividis")
            axes.plot(
                EPS_R, TABLE[m].eps_Q, "o", color="white", markeredgecolor=BLACK, label="Table 3"
            )
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.grid(visible=False)
            bar = made.colorbar(shades, ax=axes, shrink=0.9)
            bar.ax.tick_params(labelsize=7)
        label(ax, f"{m:g} %: log10 of MSE [N²]")
        label(under, "log10 of the best λ [1/N]", x="ε_R [m²]")
    for ax in (above[0], below[0]):
        ax.set_ylabel("ε_Q [N²]", fontsize=8)
    above[0].legend(fontsize=8, loc="upper right", labelcolor=BLACK)
    return made


def _edges(exponents: Sequence[int]) -> Array:
    """Limits of cells around equally spaced exponents."""
    half = (exponents[1] - exponents[0]) / 2
    return np.array([exponents[0] - half, *(k + half for k in exponents)])


def _window(e: Experiment) -> Figure:
    made = figure(1, 3, width=12.0, height=3.0)
    *left, right = made.axes
    k = np.arange(N + 1, dtype=float)
    states = e.states
    modes = states.x.shape[1] // 2
    units = {"modal positions": (1e3, "1e-3 m √kg"), "modal velocities": (1.0, "m √kg/s")}
    for first, ax, (name, (unit, text)) in zip((0, modes), left, units.items(), strict=True):
        for i in range(modes):
            x, std = states.x[:, first + i] * unit, states.x_std[:, first + i] * unit
            band(ax, k, x, std, name=f"mode {i + 1} ± 3 std", series=i)
            true = states.truth[:, first + i] * unit
            truth(ax, k, true, name="_" if i else "truth")
        label(ax, f"{name}, window {SHOWN_WINDOW}, 0 %", text, x="sample in the window")
    left[0].legend(frameon=False, fontsize=8, loc="lower left")
    alpha = e.cases[TABLE_3, READING_1, 0.0].windows.alpha[SHOWN_WINDOW]
    at_nodes(right, alpha, _wanted(SHOWN_WINDOW), k[:-1])
    label(right, "forces in the window", "N", x="step in the window")
    legend(right)
    return made


def _wanted(window: int) -> Array:
    return by_window(forces(), windows=window + 1, steps=N)[window]


def _recording(e: Experiment) -> Figure:
    made = figure(1, 2, width=10.0, height=3.2)
    for ax, m in zip(made.axes, (0.0, -3.3), strict=True):
        found = e.cases[TABLE_3, READING_1, m].windows.output
        time = 1e3 * DT * np.arange(len(found), dtype=np.float64)
        at_nodes(ax, kept(found), forces()[: len(found)], time)
        corrected = amplitude_rule(found)
        steps, nodes = np.nonzero(corrected)
        ax.plot(time[steps], corrected[steps, nodes], "s", color=ORANGE, markersize=3.5,
                label="corrected (amplitude rule)")  # fmt: skip
        label(ax, f"forces above {THRESHOLD:g} N, mismatch {m:g} %", "N")
    return finished(made, "time [ms]")


def _windows(e: Experiment) -> Figure:
    made = figure(3, 1, width=10.0, height=2.1)
    error, number, total = made.axes
    d = forces()
    for series, m in enumerate(THICKNESS):
        alpha = e.cases[TABLE_3, READING_1, m].windows.alpha
        windows = np.arange(len(alpha), dtype=float)
        line(error, windows, np.maximum(window_mse(alpha, d), 1e-9), name=f"{m:g} %", series=series)
        line(number, windows, counts(alpha), name=f"{m:g} %", series=series)
        line(total, windows, alpha.sum(axis=(1, 2)), name=f"{m:g} %", series=series)
    true = by_window(d, windows=len(windows), steps=N)
    truth(number, windows, counts(true))
    truth(total, windows, true.sum(axis=(1, 2)))
    error.set_yscale("log")
    error.set_ylim(1e-7, 1.0)
    label(error, "MSE of each window", "N²")
    label(number, f"forces of at least {THRESHOLD:g} N in the window")
    label(total, "sum of all forces in the window", "N", x="window")
    legend(error)
    legend(total)
    return made


def _mistaken_window(e: Experiment) -> Figure:
    made = figure(width=8.0, height=3.2)
    (ax,) = made.axes
    alpha = e.cases[TABLE_3, READING_1, WORST].windows.alpha[MISTAKEN_WINDOW]
    at_nodes(ax, alpha, _wanted(MISTAKEN_WINDOW), np.arange(N, dtype=float))
    label(
        ax, f"forces in window {MISTAKEN_WINDOW}, mismatch {WORST:g} %", "N", x="step in the window"
    )
    legend(ax)
    return made


def _mistaken_recording(e: Experiment) -> Figure:
    made = figure(1, 2, width=10.0, height=3.2)
    found = e.cases[TABLE_3, READING_1, WORST].windows.output
    time = 1e3 * DT * np.arange(len(found), dtype=np.float64)
    for ax, least in zip(made.axes, (THRESHOLD, 2 * THRESHOLD), strict=True):
        large = np.where(np.abs(found) >= least, found, 0.0)
        at_nodes(ax, large, forces()[: len(found)], time)
        label(ax, f"forces above {least:g} N, mismatch {WORST:g} %", "N", x="time [ms]")
        legend(ax)
    return made


def at_nodes(ax: Axes, found: Array, true: Array, at: Array) -> None:
    """Draw all forces that are not zero as stems, with the place where they act."""
    ax.axhline(0.0, color="0.6", linewidth=0.7)
    struck = true != 0
    groups = (
        ("truth", np.where(struck, true, 0.0), BLACK, "x", 6.0),
        ("estimate", np.where(struck, found, 0.0), BLUE, "o", 5.0),
        ("where nothing struck", np.where(struck, 0.0, found), VERMILLION, "v", 4.5),
    )
    for name, values, colour, marker, size in groups:
        steps, nodes = np.nonzero(values)
        if not len(steps):
            continue
        ax.vlines(at[steps], 0, values[steps, nodes], color=colour, linewidth=0.8, alpha=0.6)
        ax.plot(at[steps], values[steps, nodes], marker, color=colour, markersize=size,
                fillstyle="none", label=name)  # fmt: skip
        if name != "estimate":
            _name_places(ax, values, at, left=name != "truth")
    step = at[1] - at[0]
    ax.set_xlim(at[0] - 0.1 * step * len(at), at[-1] + 0.13 * step * len(at))
    ax.set_ylim(-12.5, 14)


def _name_places(ax: Axes, values: Array, at: Array, *, left: bool) -> None:
    """Write the place [m] beside every force above the threshold, the last of a row of them."""
    large = np.abs(values) >= THRESHOLD
    ends = large & ~np.vstack([large[1:], np.zeros_like(large[:1])])
    for number, (step, node) in enumerate(np.argwhere(ends)):
        ax.annotate(
            f"{NODES[node]:g} m",
            (at[step], values[step, node]),
            textcoords="offset points",
            xytext=(-6, (4, -5)[number % 2]) if left else (6, 0),
            ha="right" if left else "left",
            va="center",
            fontsize=7,
        )
