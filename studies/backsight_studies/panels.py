"""Figures of several plots: shared axes, one legend; and how they are written."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backsight.plot import save


def axes_by_row(made: Figure, *, shared: bool = True) -> list[list[Axes]]:
    """Plots row by row; those of a row share the vertical axis, if `shared`."""
    columns = len({ax.get_position().x0 for ax in made.axes})
    found = [made.axes[i : i + columns] for i in range(0, len(made.axes), columns)]
    if shared:
        for first, *others in found:
            for ax in others:
                ax.sharey(first)
    return found


def finished(made: Figure, x: str) -> Figure:
    """Name the horizontal axes and put one legend above all plots."""
    for ax in axes_by_row(made, shared=False)[-1]:
        ax.set_xlabel(x, fontsize=8)
    handles, names = made.axes[-1].get_legend_handles_labels()
    legend = made.legend(
        handles, names, loc="outside upper center", ncols=len(names), frameon=False, fontsize=9
    )
    for drawn in legend.get_lines():
        drawn.set_linewidth(1.6)
    return made


def save_all(figures: Mapping[str, Figure], folder: Path) -> dict[str, Path]:
    """Write all figures of a study as PNG; returns name to file."""
    return {name: save(made, folder / f"{name}.png", dpi=130) for name, made in figures.items()}
