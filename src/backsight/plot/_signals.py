"""Signals over time: states, outputs, innovations, and what is inside a window."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from backsight.analysis.bands import innovation_band, state_band
from backsight.analysis.comparison import failed, units
from backsight.description import checked
from backsight.errors import DataError
from backsight.plot._choice import (
    TIME,
    Results,
    chosen,
    finished,
    having,
    names_with_units,
    results_by_name,
    set_range,
    signal_of,
    thin_line,
    time_of,
)
from backsight.plot._figures import INK, band, figure, label, shaded, truth
from backsight.report.ranges import view
from backsight.schema import VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE


@checked()
def draw_states(
    results: Results,
    names: Sequence[str] = (),
    *,
    reference: Mapping[str, float] | None = None,
    deviations: float = 3.0,
) -> Figure:
    """Draw states, parameters and forces over time with their bands, a plot each.

    Parameters
    ----------
    results : xarray.Dataset or dict
        A result, or several by name, as from `compare`. The truth is drawn, dashed, where a result
        holds it (`simulate`).
    names : sequence of str
        Which states; all if not given.
    reference : dict, optional
        Known values of some states [their units], drawn as dotted lines.
    deviations : float
        Half the width of the bands in standard deviations.

    Returns
    -------
    matplotlib.figure.Figure
        Shows itself in a notebook; `save` writes it.

    Raises
    ------
    DataError
        If there is no such state.
    """
    return _estimated(results, names, _STATES, reference or {}, deviations)


@checked()
def draw_virtual(results: Results, names: Sequence[str] = (), *, deviations: float = 3.0) -> Figure:
    """Draw virtual outputs, quantities without a sensor, over time with their bands, a plot each.

    Parameters
    ----------
    results, names, deviations
        As in `draw_states`, of virtual outputs.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If there is no such virtual output.
    """
    return _estimated(results, names, _VIRTUAL, {}, deviations)


_STATES = ("state", "x_hat", "x_std", "x_true")
_VIRTUAL = ("virtual", VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE)
"""Dimension, and variables of estimate, deviation and truth."""


def _estimated(
    results: Results,
    names: Sequence[str],
    of: tuple[str, str, str, str],
    reference: Mapping[str, float],
    deviations: float,
) -> Figure:
    """What is estimated over time with its bands."""
    dim, value, deviation, true = of
    every = results_by_name(results)
    known = names_with_units(every, dim)
    if not known:
        raise DataError("the results have no virtual outputs: give the model some, `with_virtual`")
    shown = chosen(names, known, dim)
    made = figure(len(shown), height=1.7 if len(shown) > 3 else 2.2)
    for axes, name in zip(made.axes, shown, strict=True):
        ranged, edges = [], []
        for i, (who, result) in enumerate(having(every, dim, name)):
            x, std = (signal_of(result, variable, dim, name) for variable in (value, deviation))
            ends = (x - deviations * std, x + deviations * std)
            if dim == "state":
                ends = state_band(result, name, deviations=deviations)
            shaded(axes, time_of(result), x, ends, name=who, series=i)
            if not failed(result):
                ranged.append(x)
                edges += ends
        for _, result in having(every, dim, name)[:1]:
            if true in result:
                x = signal_of(result, true, dim, name)
                truth(axes, time_of(result), x)
                ranged.append(x)
        if name in reference:
            axes.axhline(reference[name], color=INK, linewidth=1.0, linestyle=":")
            ranged.append(np.array([reference[name]]))
        set_range(axes, view(ranged, edges))
        label(axes, name, known[name])
    return finished(made)


@checked()
def draw_outputs(results: Results, names: Sequence[str] = ()) -> Figure:
    """Draw measured and estimated outputs over time, a plot each.

    Parameters
    ----------
    results, names
        As in `draw_states`, of outputs.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If there is no such output.
    """
    every = results_by_name(results)
    known = names_with_units(every, "output")
    shown = chosen(names, known, "output")
    made = figure(len(shown))
    for axes, name in zip(made.axes, shown, strict=True):
        those = having(every, "output", name)
        y, time = signal_of(those[0][1], "y", "output", name), time_of(those[0][1])
        axes.plot(time, y, color="#7d858d", linewidth=3.0, label="measured")
        for i, (who, result) in enumerate(those):
            thin_line(axes, result, signal_of(result, "y_hat", "output", name), name=who, series=i)
        label(axes, name, known[name])
    return finished(made)


@checked()
def draw_innovations(results: Results, names: Sequence[str] = ()) -> Figure:
    """Draw innovations over time between three of their own standard deviations.

    Of a consistent estimator 99.7 % lie between the lines, without a pattern.

    Parameters
    ----------
    results, names
        As in `draw_states`, of outputs.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If there is no such output.
    """
    every = results_by_name(results)
    known = names_with_units(every, "output")
    rows = [
        (i, who, result, name)
        for name in chosen(names, known, "output")
        for i, (who, result) in enumerate(having(every, "output", name))
    ]
    made = figure(len(rows), height=1.6)
    for axes, (i, who, result, name) in zip(made.axes, rows, strict=True):
        e, bound = innovation_band(result, name)
        thin_line(axes, result, e, name=who, series=i, width=0.8)
        for side in (-bound, bound):
            axes.plot(time_of(result), side, color=INK, linewidth=0.8)
        set_range(axes, view([e], [-bound, bound]))
        label(axes, f"{who}: innovation of {name}", known[name])
    made.axes[-1].set_xlabel(TIME, fontsize=8)
    return made


@checked()
def draw_window(window: xr.Dataset, names: Sequence[str] = ()) -> Figure:
    """Draw the states inside a window, given all measurements in it, with three-sigma bands.

    Parameters
    ----------
    window : xarray.Dataset
        From `solve_window`.
    names : sequence of str
        Which states; all if not given.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    DataError
        If this is no window, or there is no such state.
    """
    if "x" not in window:
        raise DataError("draw_window draws what solve_window returns; for results take draw_states")
    known = units(window, "state")
    shown = chosen(names, known, "state")
    made = figure(len(shown), height=1.7)
    for axes, name in zip(made.axes, shown, strict=True):
        x, std = signal_of(window, "x", "state", name), signal_of(window, "x_std", "state", name)
        band(axes, time_of(window), x, std, name="window", series=0)
        label(axes, name, known[name])
    made.axes[-1].set_xlabel(TIME, fontsize=8)
    return made
