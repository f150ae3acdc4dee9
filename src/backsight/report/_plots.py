"""The plots of the page: one function per kind, each from results to plotly.js figures."""

import math
from collections.abc import Sequence

import numpy as np

from backsight.analysis.bands import innovation_band
from backsight.analysis.comparison import failed
from backsight.analysis.consistency import windowed_nis
from backsight.report._series import Plot, Series, quantity, signal_units
from backsight.report._theme import heading, remark
from backsight.report._traces import Trace, band_trace, limits, line_trace, literal_text
from backsight.report.ranges import bulk, view
from backsight.report.thin import Positions
from backsight.schema import Status
from backsight.types import Array

_NIS_WINDOWS = 200


def output_plots(every: Sequence[Series]) -> list[Plot]:
    """Measured and estimated outputs with their residuals, one plot per output."""
    return [_output(every, name, unit) for name, unit in signal_units(every, "output").items()]


def input_plots(every: Sequence[Series]) -> list[Plot]:
    """Known inputs, one plot each."""
    plots = []
    for name, unit in signal_units(every, "input").items():
        first = next(s for s in every if s.has("input", name))
        values = first.signal("u", "input", name)
        trace = line_trace(first.time, values, name=name, colour="--measured", width=1.2)
        layout = {
            "annotations": [heading(literal_text(quantity(name, unit)))],
            "yaxis": {"range": view([values], [])},
        }
        plots.append(Plot(f"input {name} over time", [trace], layout, height=190, wide=True))
    return plots


def innovation_plots(every: Sequence[Series]) -> list[Plot]:
    """Innovations of every output and estimator within three standard deviations."""
    plots = []
    for name, unit in signal_units(every, "output").items():
        having = [s for s in every if s.has("output", name)]
        sound = [innovation_band(s.result, name) for s in sound_ones(having)]
        span = view([bulk(e) for e, _ in sound], [b for _, bound in sound for b in (-bound, bound)])
        plots += [
            _innovations(s, name, unit, span=span, wide=len(having) == 1, first=s is having[0])
            for s in having
        ]
    return plots


def nis_plot(every: Sequence[Series]) -> Plot:
    """Mean NIS of successive windows with the 95 % interval of a consistent estimator."""
    longest = max(len(s.time) for s in every)
    window = max(-(-longest // _NIS_WINDOWS), min(10, longest))
    means = [(s, windowed_nis(s.result, window)) for s in every]
    interval = means[0][1]
    time = interval["time"].values
    lower, upper = interval["lower"].values, interval["upper"].values
    traces = [band_trace(time, lower, upper, colour="--neutral-band")]
    traces += [line_of(s, w["nis"].values, time=w["time"].values, width=1.4) for s, w in means]
    values = [np.log10(w["nis"].where(w["nis"] > 0).values) for _, w in means]
    span = view(values, [np.log10(lower[lower > 0]), np.log10(upper[upper > 0])])
    title = f"mean NIS of {window} samples [1]" if window > 1 else "NIS [1]"
    layout = {
        "annotations": [heading(title), remark("95 % band")],
        "yaxis": {"type": "log", "range": span, "exponentformat": "none", **log_ticks(span)},
    }
    return Plot("normalised innovation squared over time", traces, layout, height=260, wide=True)


def status_plots(every: Sequence[Series]) -> list[Plot]:
    """When which status occurred; no plot if there is nothing to report."""
    rows = [
        (s, bit, np.flatnonzero(s.result["status"].values.astype(int) & bit.value))
        for s in every
        for bit in Status
    ]
    rows = [row for row in rows if row[2].size]
    if not rows:
        return []
    labels = [
        heading(literal_text(f"{s.name}: {status_in_words(bit)}"))
        | {"yref": "y", "y": -i, "yshift": 8}
        for i, (s, bit, _) in enumerate(rows)
    ]
    traces = [_ticks(s, where, -i) for i, (s, _, where) in enumerate(rows)]
    rest = {"showticklabels": False, "showgrid": False, "fixedrange": True}
    layout = {
        "annotations": labels,
        "yaxis": {"range": [0.5 - len(rows), 0.9], **rest},
        "hovermode": "closest",
    }
    return [Plot("status over time", traces, layout, height=62 + 44 * len(rows), wide=True)]


def status_in_words(bit: Status) -> str:
    """Return the name of a status in words."""
    return str(bit.name).replace("_", " ").lower()


def _output(every: Sequence[Series], name: str, unit: str) -> Plot:
    having = [s for s in every if s.has("output", name)]
    y = having[0].signal("y", "output", name)
    traces = [line_trace(having[0].time, y, name="measured", colour="--measured", width=4)]
    traces += [line_of(s, s.signal("y_hat", "output", name)) for s in having]
    traces += [line_of(s, _residual(s, name), axis="y2", width=0.9) for s in having]
    sound = sound_ones(having)
    upper = view([y, *(s.signal("y_hat", "output", name) for s in sound)], [])
    lower = view([_residual(s, name) for s in sound], [])
    title = literal_text(quantity(name, unit))
    residual = heading(f"residual: measured − estimated {title}", y=0.30)
    layout = {
        "annotations": [heading(title), residual],
        "xaxis": {"anchor": "y2"},
        "yaxis": {"domain": [0.45, 1], "range": upper},
        "yaxis2": {"domain": [0, 0.30], "range": lower},
    }
    return Plot(
        f"output {name}: measured and estimated", traces, layout, height=400, wide=True, about=name
    )


def _residual(s: Series, name: str) -> Array:
    return s.signal("y", "output", name) - s.signal("y_hat", "output", name)


def sound_ones(having: Sequence[Series]) -> Sequence[Series]:
    """Choose what vertical ranges follow: estimators that did not diverge, if there is one."""
    return [s for s in having if not failed(s.result)] or having


def _short(name: str) -> str:
    """Cut a name so that it leaves room beside it."""
    return name if len(name) <= 28 else f"{name[:27].rstrip()}…"


def _innovations(
    s: Series, name: str, unit: str, *, span: list[float] | None, wide: bool, first: bool
) -> Plot:
    e, bound = innovation_band(s.result, name)
    title = heading(literal_text(f"{_short(s.name)}: {quantity(name, unit)}"))
    return Plot(
        f"innovation of {name}, {s.name}",
        [line_of(s, e, width=0.8), limits(s.time, bound, group=s.group)],
        {"annotations": [title, *_inside(e, bound)], "yaxis": {"range": span}},
        wide=wide,
        first=first,
        about=name,
    )


def _inside(e: Array, bound: Array) -> list[dict[str, object]]:
    """How many innovations lie within their bounds, as a remark; none if that is unknown."""
    known = np.isfinite(e) & np.isfinite(bound)
    if not known.any():
        return []
    share = 100.0 * np.mean(np.abs(e[known]) <= bound[known])
    return [remark(f"{share:.1f} % within ±3σ")]


def log_ticks(span: list[float] | None) -> dict[str, object]:
    """Ticks of a logarithmic axis: powers of ten, or 1, 2, 5 if it spans few of them."""
    if span is None or span[1] - span[0] > 2.0:
        return {"dtick": 1}
    powers = range(math.floor(span[0]), math.ceil(span[1]) + 1)
    values = [digit * 10.0**power for power in powers for digit in (1, 2, 5)]
    return {"tickvals": values, "ticktext": [f"{v:g}" for v in values]}


def line_of(
    s: Series,
    values: Array,
    *,
    time: Array | None = None,
    width: float | None = None,
    std: Array | None = None,
    axis: str = "y",
) -> Trace:
    """One estimator's line; the first ones are thicker, to be seen where the later cover them."""
    return line_trace(
        s.time if time is None else time,
        values,
        name=s.name,
        colour=s.colour,
        group=s.group,
        dash=s.dash,
        width=max(2.6 - 1.4 * s.number, 1.2) if width is None else width,
        std=std,
        axis=axis,
    )


def _ticks(s: Series, where: Positions, row: int) -> Trace:
    """A stroke per sample, at most a thousand of them."""
    places = np.linspace(s.time[0], s.time[-1], 1000)
    drawn = s.time[where] if where.size <= 1000 else _nearest(places, s.time[where])
    return {
        "type": "scatter",
        "mode": "markers",
        "x": list(map(float, drawn)),
        "y": [row] * len(drawn),
        "legendgroup": s.group,
        "marker": {"symbol": "line-ns", "size": 9, "line": {"color": s.colour, "width": 1}},
        "hovertemplate": "%{x:.6~g} s<extra></extra>",
    }


def _nearest(places: Array, times: Array) -> Array:
    step = places[1] - places[0]
    return places[np.unique(np.rint((times - places[0]) / step).astype(int))]
