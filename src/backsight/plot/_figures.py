"""One calm style, bands, and files that are whole or not there.

Figures are drawn with matplotlib's Agg canvas without pyplot, so nothing global is touched: no
back end is chosen for the program, and no figure stays in memory when its variable is gone.
"""

import io
import os
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from backsight.output import write_whole
from backsight.report.palette import ON_LIGHT
from backsight.types import Array

INK, MUTED, GRID = "#1d2126", "#656d76", "#e8eaeb"


class Drawing(Figure):
    """A figure that shows itself in a notebook, without pyplot."""

    def _repr_png_(self) -> bytes:
        return _png(self, dpi=110)


def figure(rows: int = 1, columns: int = 1, *, width: float = 7.0, height: float = 2.2) -> Figure:
    """Make a figure of plots above each other that share the time axis.

    Parameters
    ----------
    rows, columns : int
        Number of plots; ``figure.axes`` lists them row by row. Plots of a column share the
        horizontal axis.
    width, height : float
        Width of the figure and height of one row [inch].
    """
    made = Drawing(figsize=(width, height * rows), layout="constrained", facecolor="white")
    FigureCanvasAgg(made)
    made.subplots(rows, columns, sharex="col", squeeze=False)
    for axes in made.axes:
        _calm(axes)
    return made


def label(axes: Axes, quantity: str, unit: str = "", *, x: str | None = None) -> None:
    """Name the axes: ``quantity [unit]`` above the left end, `x` below.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    quantity, unit : str
        What is drawn and in which unit.
    x : str, optional
        Label of the horizontal axis, with its unit; nothing if not given.
    """
    text = f"{quantity} [{unit}]" if unit else quantity
    axes.set_title(text, loc="left", fontsize=9, color=INK)
    if x is not None:
        axes.set_xlabel(x, fontsize=8, color=MUTED)


def line(axes: Axes, time: Array, values: Array, *, name: str, series: int) -> None:
    """Draw a line in the colour of a series (0, 1, ...); the first is thicker, to be seen below.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    time, values : (n,) array
        What.
    name : str
        For the legend.
    series : int
        Number of the colour; after six they repeat.
    """
    width = max(2.0 - series, 1.0)
    axes.plot(time, values, color=colour(series), linewidth=width, label=name)


def band(
    axes: Axes,
    time: Array,
    values: Array,
    std: Array,
    *,
    name: str,
    series: int,
    deviations: float = 3.0,
) -> None:
    """Draw an estimate and its band of some standard deviations.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    time, values, std : (n,) array
        Estimate and its standard deviation.
    name, series
        As in `line`.
    deviations : float
        Half the width of the band in standard deviations.
    """
    ends = (values - deviations * std, values + deviations * std)
    shaded(axes, time, values, ends, name=name, series=series)


def shaded(
    axes: Axes, time: Array, values: Array, ends: tuple[Array, Array], *, name: str, series: int
) -> None:
    """Draw an estimate and what lies between both ends, (n,), of its band."""
    axes.fill_between(time, *ends, color=colour(series), alpha=0.16, linewidth=0)
    line(axes, time, values, name=name, series=series)


def truth(axes: Axes, time: Array, values: Array, *, name: str = "truth") -> None:
    """Draw what is known to be true, dashed in black."""
    axes.plot(time, values, color=INK, linewidth=1.0, linestyle=(0, (4, 2)), label=name)


def legend(axes: Axes) -> None:
    """Add a legend without a box."""
    axes.legend(frameon=False, fontsize=8, ncols=4, loc="best", labelcolor=INK)


def save(figure: Figure, path: str | os.PathLike[str], *, dpi: int = 160) -> Path:
    """Write the figure as PNG; raises `OutputError` if that is not possible."""
    return write_whole(path, _png(figure, dpi=dpi))


def _png(figure: Figure, *, dpi: int) -> bytes:
    # Not `savefig`, which lays out and draws everything twice.
    picture, before = io.BytesIO(), figure.dpi
    figure.set_dpi(dpi)
    FigureCanvasAgg(figure).print_png(picture)
    figure.set_dpi(before)
    return picture.getvalue()


def colour(series: int) -> str:
    """Colour of a series (0, 1, ...)."""
    return ON_LIGHT[series % len(ON_LIGHT)]


def _calm(axes: Axes) -> None:
    axes.set_axisbelow(True)
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color("#c9cdd1")
    axes.tick_params(axis="both", labelsize=8, labelcolor=MUTED, color="#c9cdd1", length=3)
    axes.tick_params(axis="y", length=0)
    axes.margins(x=0)
