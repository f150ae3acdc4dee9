"""Unknown forces over place and time as a static figure."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from backsight.analysis.forces import forces, hits, where
from backsight.description import checked
from backsight.errors import DataError
from backsight.plot._choice import TIME, Results, results_by_name
from backsight.plot._figures import INK, figure, label
from backsight.report.palette import BLUE, VERMILLION
from backsight.report.thin import peaks

_COLUMNS = 400
_AREA = (60.0, 360.0)  # of the circles [points squared]
_COLOURS = LinearSegmentedColormap.from_list("forces", [BLUE, "#ffffff", VERMILLION])


def force_map(axes: Axes, result: xr.Dataset, *, name: str, circles: int = 12) -> None:
    """Draw the force in colour, place over time, and circles round the largest hits.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    result : xarray.Dataset
        With unknown forces ``d_hat``.
    name : str
        Of the estimator.
    circles : int
        Hits that get a circle.

    Raises
    ------
    DataError
        If the result has no unknown forces.
    """
    found = hits(result)
    if found is None:
        raise DataError("the result has no unknown forces 'd_hat' to draw a map of")
    held, _ = forces(result)
    places = where(result)
    kept, length = peaks(held.values, _COLUMNS)
    step = length * float(result.attrs["dt"])
    start, largest = float(result["time"][0]), float(np.abs(kept).max(initial=0.0)) or 1.0
    picture = axes.imshow(
        kept.T,
        aspect="auto",
        origin="lower",
        interpolation="nearest",
        extent=(start, start + len(kept) * step, -0.5, len(places) - 0.5),
        cmap=_COLOURS,
        vmin=-largest,
        vmax=largest,
    )
    shown = found.hits[:circles]
    if shown:
        rows = [places.index(hit.where) for hit in shown]
        size = np.abs([hit.force for hit in shown]) / max(abs(hit.force) for hit in shown)
        area = _AREA[0] + (_AREA[1] - _AREA[0]) * size
        times = [hit.impact.time for hit in shown]
        axes.scatter(times, rows, s=area, facecolors="none", edgecolors=INK, linewidths=1.0)
    axes.set_yticks(range(len(places)), places)
    axes.set_ylim(-0.6, len(places) - 0.4)
    axis = "place (position [m])" if "force_position" in held.coords else "place"
    unit = f" [{found.unit}]" if found.unit else ""
    label(axes, f"{name}: force{unit} over {axis}")
    made = axes.get_figure()
    if made is not None:
        bar = made.colorbar(picture, ax=axes, pad=0.01, fraction=0.03)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=8, length=0)


@checked()
def draw_forces(results: Results) -> Figure:
    """Draw unknown forces as maps, place over time, with circles round the largest hits.

    Parameters
    ----------
    results
        As in `draw_states`; those without unknown forces are left out.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If no result has unknown forces.
    """
    those = [(who, r) for who, r in results_by_name(results).items() if hits(r) is not None]
    if not those:
        raise DataError("no result has unknown forces 'd_hat' to draw a map of")
    made = figure(len(those), width=8.0, height=2.6)
    for axes, (who, result) in zip(made.axes, those, strict=False):
        force_map(axes, result, name=who)
    made.axes[len(those) - 1].set_xlabel(TIME, fontsize=8)
    return made
