"""Which forces are certain to be found, as maps."""

import math

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure

from backsight.description import checked
from backsight.errors import DataError
from backsight.plot._figures import INK, figure, label
from backsight.types import Array

_LEVELS = (0.0, 0.5, 0.75, 0.9, 1.0, 2.0, math.inf)
_COLOURS = ListedColormap(["#08306b", "#2171b5", "#6baed6", "#c6dbef", "#fdd0a2", "#d55e00"])
"""Blue is certain, the darker the clearer; orange is not."""


@checked()
def draw_recovery(certified: xr.Dataset) -> Figure:
    """Draw which forces alone, and which two at once, are certain to be found.

    Ratios below one, in blue, are certain; those in orange are not found for some sizes.

    Parameters
    ----------
    certified : xarray.Dataset
        Of `backsight.check.check_recovery`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If it is something else.

    Examples
    --------
    >>> from backsight import plot
    >>> sensors, forces = {"tip": ("displacement", [1.0])}, {"hit": [1.0]}
    >>> rod = bs.modal([9.0], damping=[0.03], sensors=sensors, forces=forces)
    >>> noise, prior = bs.Noise(sigma_y=1e-5), bs.Prior(sigma_x0=1e-5)
    >>> finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=4)
    >>> drawn = plot.draw_recovery(bs.check.check_recovery(finder, rod, dt=0.01))
    """
    if not {"ratio", "pair_ratio"} <= set(certified.data_vars):
        raise DataError(
            "there are no ratios to draw; give what backsight.check.check_recovery says"
        )
    names = [str(n) for n in certified["atom"].values]
    made = figure(1, 2, width=9.0, height=1.4 + 0.22 * len(names))
    ages = [str(a) for a in certified["age"].values]
    alone, two = made.axes
    _map(made, alone, certified["ratio"].values.T, names, ages)
    label(alone, "A force alone: ratio over place", x="age: samples since it began")
    _map(made, two, certified["pair_ratio"].values, names, names)
    label(two, "Two at once, the worst moment")
    two.tick_params(axis="x", rotation=90)
    return made


def _map(made: Figure, axes: Axes, values: Array, rows: list[str], columns: list[str]) -> None:
    picture = axes.imshow(
        np.clip(values, 0.0, 1e3),
        aspect="auto",
        origin="lower",
        interpolation="nearest",
        cmap=_COLOURS,
        norm=BoundaryNorm((*_LEVELS[:-1], 1e4), _COLOURS.N),
    )
    axes.set_yticks(range(len(rows)), rows)
    axes.set_xticks(range(len(columns)), columns)
    axes.grid(visible=False)
    bar = made.colorbar(picture, ax=axes, pad=0.02, fraction=0.05, ticks=_LEVELS[:-1])
    bar.ax.tick_params(labelsize=8, length=0, colors=INK)
    bar.outline.set_visible(False)
