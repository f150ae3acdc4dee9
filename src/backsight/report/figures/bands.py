"""Plots of what is estimated, with bands: states, parameters, quantities without a sensor."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from backsight.analysis.bands import state_band
from backsight.report._plots import line_of, sound_ones
from backsight.report._series import Plot, Series, quantity, signal_units
from backsight.report._theme import heading
from backsight.report._traces import band_trace, line_trace, literal_text
from backsight.report.ranges import view
from backsight.schema import VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class _Estimated:
    """Dimension and variables of what is drawn with its bands."""

    dim: str
    value: str
    std: str
    truth: str


_STATES = _Estimated("state", "x_hat", "x_std", "x_true")
_VIRTUAL = _Estimated("virtual", VIRTUAL, VIRTUAL_STD, VIRTUAL_TRUE)


def state_plots(
    every: Sequence[Series], reference: Mapping[str, float], names: Sequence[str]
) -> list[Plot]:
    """States and parameters of these names with their 3-sigma bands, one plot each."""
    units = signal_units(every, "state")
    return [_state(every, name, units[name], reference.get(name)) for name in names]


def virtual_plots(every: Sequence[Series]) -> list[Plot]:
    """Every quantity without a sensor with its 3-sigma bands, one plot each."""
    return [
        _state(every, name, unit, None, of=_VIRTUAL)
        for name, unit in signal_units(every, "virtual").items()
    ]


def _state(
    every: Sequence[Series],
    name: str,
    unit: str,
    reference: float | None,
    *,
    of: _Estimated = _STATES,
) -> Plot:
    having = [s for s in every if s.has(of.dim, name)]
    sound = sound_ones(having)
    traces = [
        band_trace(s.time, *_edges(s, name, of), colour=f"{s.colour}-band", group=s.group)
        for s in having
    ]
    traces += [
        line_of(s, s.signal(of.value, of.dim, name), std=s.signal(of.std, of.dim, name))
        for s in having
    ]
    shown = [s.signal(of.value, of.dim, name) for s in sound]
    shapes = []
    if truth := next((s for s in having if of.truth in s.result), None):
        x = truth.signal(of.truth, of.dim, name)
        traces.append(
            line_trace(truth.time, x, name="truth", colour="--ink", width=1.2, dash="dash")
        )
        shown.append(x)
    if reference is not None:
        shapes.append(_level(reference))
        shown.append(np.array([reference]))
    layout = {
        "annotations": [heading(literal_text(quantity(name, unit)))],
        "yaxis": {"range": view(shown, [edge for s in sound for edge in _edges(s, name, of)])},
        "shapes": shapes,
    }
    return Plot(f"{of.dim} {name} over time with bands", traces, layout)


def _edges(s: Series, name: str, of: _Estimated) -> tuple[Array, Array]:
    if of is _STATES:
        return state_band(s.result, name)
    x, std = s.signal(of.value, of.dim, name), s.signal(of.std, of.dim, name)
    return x - 3.0 * std, x + 3.0 * std


def _level(value: float) -> dict[str, object]:
    pen = {"color": "--ink", "width": 1.2, "dash": "dot"}
    ends = {"xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value}
    return {"type": "line", "layer": "above", "line": pen, **ends}
