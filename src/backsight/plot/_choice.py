"""What figures of results have in common: which results, which signals, ranges, legends."""

from collections.abc import Mapping, Sequence

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backsight.analysis.comparison import units
from backsight.errors import DataError, nearest
from backsight.plot._figures import colour, legend
from backsight.report.thin import thin
from backsight.types import Array

Results = xr.Dataset | Mapping[str, xr.Dataset]
"""One result, or several by the names that the legend shall have."""

TIME = "time [s]"


def results_by_name(results: Results) -> dict[str, xr.Dataset]:
    """Results by name; one alone is called as its estimator."""
    every = (
        {str(results.attrs.get("estimator", "estimate")): results}
        if isinstance(results, xr.Dataset)
        else dict(results)
    )
    if not every:
        raise DataError("there are no results to draw: give at least one")
    return every


def names_with_units(every: Mapping[str, xr.Dataset], dim: str) -> dict[str, str]:
    """Name and unit of all states or outputs (`dim`) that occur, in order."""
    having_it = (result for result in every.values() if dim in result.dims)
    return {n: u for result in having_it for n, u in units(result, dim).items()}


def chosen(names: Sequence[str], known: Mapping[str, str], dim: str) -> list[str]:
    """Names that are to be drawn; all if none is wanted."""
    wrong = [n for n in names if n not in known]
    if wrong:
        raise DataError(f"the results have no {dim} '{wrong[0]}': {nearest(wrong[0], known)}")
    return list(names) or list(known)


def having(every: Mapping[str, xr.Dataset], dim: str, name: str) -> list[tuple[str, xr.Dataset]]:
    """Results that have this state or output."""
    return [(who, r) for who, r in every.items() if dim in r.dims and name in r[dim].values]


def time_of(result: xr.Dataset) -> Array:
    """Time of the samples [s], (n,)."""
    return result["time"].values.astype(float)


def signal_of(result: xr.Dataset, variable: str, dim: str, name: str) -> Array:
    """One column of a variable, (n,)."""
    return result[variable].sel({dim: name}).values.astype(float)


def thin_line(
    axes: Axes, result: xr.Dataset, values: Array, *, name: str, series: int, width: float = 1.3
) -> None:
    """Draw one line; of a long one the smallest and largest value of every interval."""
    kept = thin(values, 20_000)
    axes.plot(
        time_of(result)[kept], values[kept], color=colour(series), linewidth=width, label=name
    )


def set_range(axes: Axes, span: list[float] | None) -> None:
    """Set the vertical range, if there is one."""
    if span is not None and span[0] < span[1]:
        axes.set_ylim(*span)


def finished(made: Figure) -> Figure:
    """Name the time axis below, and add a legend above."""
    made.axes[-1].set_xlabel(TIME, fontsize=8)
    if len(made.axes[0].get_legend_handles_labels()[1]) > 1:
        legend(made.axes[0])
    return made
