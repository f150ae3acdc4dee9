"""What the page draws: one series per estimator, and plots with their place."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import xarray as xr

from backsight.analysis.comparison import units
from backsight.report._traces import Trace
from backsight.report.palette import DASHES, ON_LIGHT
from backsight.types import Array


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """One estimator's result, and how it is drawn everywhere on the page."""

    name: str
    result: xr.Dataset
    number: int

    @property
    def colour(self) -> str:
        """Name of the CSS variable."""
        return f"--series-{self.number % len(ON_LIGHT)}"

    @property
    def dash(self) -> str:
        """Line style."""
        return DASHES[self.number // len(ON_LIGHT) % len(DASHES)]

    @property
    def group(self) -> str:
        """What the legend of the page switches on and off."""
        return str(self.number)

    @property
    def time(self) -> Array:
        """Time of the samples [s], (n,)."""
        return self.result["time"].values.astype(float)

    def has(self, dim: str, name: str) -> bool:
        """Whether the result has this input, output or state."""
        return dim in self.result.dims and name in self.result[dim].values

    def signal(self, variable: str, dim: str, name: str) -> Array:
        """One column of a variable, (n,)."""
        return self.result[variable].sel({dim: name}).values.astype(float)


@dataclasses.dataclass(frozen=True)
class Plot:
    """A plotly.js figure with its place on the page.

    Parameters
    ----------
    label : str
        What it shows, for screen readers.
    traces, layout : list, dict
        As plotly.js takes them; colours may be names of CSS variables.
    height : int
        In pixels.
    wide : bool
        Whether it takes the whole width of the page.
    first : bool
        Whether it starts a new row.
    over : str
        Its horizontal axis; those over time share it.
    about : str
        Output that it is about; nothing if it is about something else.
    """

    label: str
    traces: list[Trace]
    layout: dict[str, object]
    height: int = 230
    wide: bool = False
    first: bool = False
    over: Literal["time", "frequency"] = "time"
    about: str = ""


def series(results: Mapping[str, xr.Dataset]) -> list[Series]:
    """Number the estimators in the order given."""
    return [Series(name, result, i) for i, (name, result) in enumerate(results.items())]


def signal_units(every: Sequence[Series], dim: str) -> dict[str, str]:
    """Name and unit of all inputs, outputs or states (`dim`) that occur, in order."""
    found: dict[str, str] = {}
    for s in every:
        if dim in s.result.coords:
            found |= {n: u for n, u in units(s.result, dim).items() if n not in found}
    return found


def quantity(name: str, unit: str) -> str:
    """Return the label of an axis: ``q [um]``."""
    return f"{name} [{unit}]" if unit else name
