"""How good estimators are: consistency over time and frequency, and beside each other."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from backsight.analysis.consistency import innovation_spectrum, mean_nis, nis_band, windowed_nis
from backsight.description import checked
from backsight.plot._choice import (
    Results,
    chosen,
    finished,
    having,
    names_with_units,
    results_by_name,
)
from backsight.plot._figures import GRID, INK, colour, figure, label, legend, line

_NIS_WINDOWS = 60


@checked()
def draw_nis(results: Results) -> Figure:
    """Draw the normalised innovation squared, averaged over windows, and its 95 % band.

    Above the band an estimator is over-confident, below it too cautious.

    Parameters
    ----------
    results
        As in `draw_states`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    every = results_by_name(results)
    longest = max(result.sizes["time"] for result in every.values())
    window = max(-(-longest // _NIS_WINDOWS), min(10, longest))
    made = figure()
    axes = made.axes[0]
    for i, (who, result) in enumerate(every.items()):
        means = windowed_nis(result, window)
        if not i:
            low, high = means["lower"].values, means["upper"].values
            grey = {"color": INK, "alpha": 0.1, "linewidth": 0}
            axes.fill_between(means["time"].values, low, high, label="95 % band", **grey)
        line(axes, means["time"].values, means["nis"].values, name=who, series=i)
    axes.set_yscale("log")
    label(axes, f"mean NIS of {window} samples", "1")
    return finished(made)


@checked()
def draw_spectrum(results: Results, names: Sequence[str] = ()) -> Figure:
    """Draw the power spectral density of the normalised innovations (Welch's method).

    That of a consistent estimator is flat: 1 at every frequency. A peak is a mode or an order that
    the model lacks, a slope towards low frequencies a drift.

    Parameters
    ----------
    results, names
        As in `draw_states`, of outputs. Samples without a measurement count as 0.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If there is no such output.
    """
    every = results_by_name(results)
    shown = chosen(names, names_with_units(every, "output"), "output")
    made = figure(len(shown))
    for axes, name in zip(made.axes, shown, strict=True):
        for i, (who, result) in enumerate(having(every, "output", name)):
            line(axes, *innovation_spectrum(result, name), name=who, series=i)
        axes.axhline(1.0, color=INK, linewidth=1.0, linestyle=":", label="white")
        axes.set_yscale("log")
        label(axes, f"density of the normalised innovations of {name}", "1")
    made.axes[-1].set_xlabel("frequency [Hz]", fontsize=8)
    legend(made.axes[0])
    return made


@checked()
def draw_comparison(results: Results) -> Figure:
    """Draw how consistent and how fast estimators are: mean NIS with its band, time per sample.

    Parameters
    ----------
    results
        As in `draw_states`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    every = results_by_name(results)
    made = figure(1, 2, height=0.5 + 0.3 * len(every))
    left, right = made.axes
    rows = range(len(every))
    for row, result in zip(rows, every.values(), strict=True):
        low, high = nis_band(result)
        grey = {"color": INK, "alpha": 0.15, "linewidth": 6, "solid_capstyle": "butt"}
        left.plot([low, high], [row, row], **grey)
        left.plot([mean_nis(result)], [row], "o", color=colour(row))
        right.plot([float(result.attrs["us_per_sample"])], [row], "o", color=colour(row))
    for axes in (left, right):
        axes.set_yticks(rows, list(every) if axes is left else [])
        axes.set_ylim(len(every) - 0.5, -0.5)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.margins(x=0.1)
        axes.grid(axis="x", color=GRID, linewidth=0.8)
    label(left, "mean NIS and its 95 % band", "1")
    label(right, "time per sample", "us")
    return made
