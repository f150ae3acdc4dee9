"""Power of the normalised innovations over the frequency."""

from collections.abc import Sequence

import numpy as np

from backsight.analysis.consistency import innovation_spectrum
from backsight.report._plots import line_of, log_ticks
from backsight.report._series import Plot, Series, signal_units
from backsight.report._theme import heading
from backsight.report._traces import literal_text
from backsight.report.ranges import view

_AXIS = {
    "title": {"text": "frequency [Hz]", "standoff": 4, "font": {"size": 11.5}},
    "unifiedhovertitle": {"text": "%{x:.4~g} Hz"},
}
_SHORTEST = 64  # samples, below which there is no spectrum to speak of


def spectrum_plots(every: Sequence[Series]) -> list[Plot]:
    """Return a plot for each output; none of recordings that are too short."""
    plots = [_spectrum(every, name) for name in signal_units(every, "output")]
    return [plot for plot in plots if plot.traces]


def _spectrum(every: Sequence[Series], name: str) -> Plot:
    long = [s for s in every if s.has("output", name) and len(s.time) >= _SHORTEST]
    lines = [(s, *innovation_spectrum(s.result, name)) for s in long if "dt" in s.result.attrs]
    lines = [(s, f, density) for s, f, density in lines if (density > 0).any()]
    traces = [line_of(s, np.where(density > 0, density, np.nan), time=f) for s, f, density in lines]
    span = view([np.log10(density[density > 0]) for _, _, density in lines], [np.zeros(2)])
    layout = {
        "annotations": [heading(literal_text(f"{name}: density of the innovations [1]"))],
        "xaxis": _AXIS,
        "yaxis": {"type": "log", "range": span, "exponentformat": "none", **log_ticks(span)},
        "shapes": [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1, **_WHITE}],
    }
    label = f"spectrum of the innovations of {name}"
    return Plot(label, traces, layout, height=230, over="frequency", about=name)


_WHITE = {"line": {"color": "--ink", "width": 1, "dash": "dot"}}
