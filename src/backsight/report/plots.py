"""The plots of the page: one function per kind, each from results to plotly.js figures."""

from collections.abc import Mapping, Sequence

import numpy as np

from backsight.analysis.consistency import measured_channels, windowed_nis
from backsight.report.series import Plot, Series, quantity, signals
from backsight.report.theme import heading, remark
from backsight.report.traces import Trace, band, limits, line, measured, plain, view
from backsight.schema import Status
from backsight.types import Array

_NIS_WINDOWS = 200


def output_plots(every: Sequence[Series]) -> list[Plot]:
    """Measured and estimated outputs with their residuals, one plot per output."""
    return [_output(every, name, unit) for name, unit in signals(every, "output").items()]


def input_plots(every: Sequence[Series]) -> list[Plot]:
    """Known inputs, one plot each."""
    plots = []
    for name, unit in signals(every, "input").items():
        first = next(s for s in every if s.has("input", name))
        values = first.signal("u", "input", name)
        trace = line(first.time, values, name=name, colour="--measured", width=1.2)
        layout = _layout(heading(plain(quantity(name, unit))), view=view([values], []))
        plots.append(Plot(f"input {name} over time", [trace], layout, height=190, wide=True))
    return plots


def state_plots(every: Sequence[Series], reference: Mapping[str, float]) -> list[Plot]:
    """Every state and parameter with its 3-sigma bands, one plot each."""
    return [
        _state(every, name, unit, reference.get(name))
        for name, unit in signals(every, "state").items()
    ]


def innovation_plots(every: Sequence[Series]) -> list[Plot]:
    """Innovations of every output and estimator within three standard deviations."""
    plots = []
    for name, unit in signals(every, "output").items():
        having = [s for s in every if s.has("output", name)]
        data = [(s, *_innovation(s, name)) for s in having]
        span = view([e for _, e, _ in data], [b for _, _, bound in data for b in (-bound, bound)])
        for s, e, bound in data:
            known = np.isfinite(e) & np.isfinite(bound)
            inside = 100.0 * np.mean(np.abs(e[known]) <= bound[known]) if known.any() else np.nan
            labels = [heading(plain(f"{s.name}: innovation of {quantity(name, unit)}"))]
            if known.any():
                labels.append(remark(f"{inside:.1f} % within ±3σ"))
            traces = [
                _line(s, e, width=0.8),
                limits(s.time, bound, group=s.group),
            ]
            label = f"innovation of {name}, {s.name}"
            plots.append(Plot(label, traces, _layout(*labels, view=span), wide=len(having) == 1))
    return plots


def nis_plot(every: Sequence[Series]) -> Plot:
    """Mean NIS of successive windows with the 95 % interval of a consistent estimator."""
    longest = max(len(s.time) for s in every)
    window = -(-longest // _NIS_WINDOWS)
    means = [(s, windowed_nis(s.result, window)) for s in every]
    interval = means[0][1]
    time = interval["time"].values
    lower, upper = interval["lower"].values, interval["upper"].values
    traces = [band(time, lower, upper, colour="--neutral-band")]
    traces += [_line(s, w["nis"].values, time=w["time"].values, width=1.4) for s, w in means]
    values = [np.log10(w["nis"].where(w["nis"] > 0).values) for _, w in means]
    span = view(values, [np.log10(lower[lower > 0]), np.log10(upper[upper > 0])])
    expected = float(measured_channels(every[0].result).where(lambda m: m > 0).mean())
    title = f"mean NIS of {window} samples [1]" if window > 1 else "NIS [1]"
    layout = _layout(heading(title), remark("band: 95 % of a consistent estimator"), view=span)
    layout["yaxis"] |= {"type": "log", "dtick": "D2", "exponentformat": "none"}
    if np.isfinite(expected):
        layout["shapes"] = [_level(expected, dash="solid")]
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
        heading(plain(f"{s.name}: {words(bit)}")) | {"yref": "y", "y": -i, "yshift": 8}
        for i, (s, bit, _) in enumerate(rows)
    ]
    traces = [_ticks(s, where, -i) for i, (s, _, where) in enumerate(rows)]
    ends = [min(s.time[0] for s in every), max(s.time[-1] for s in every)]
    layout = _layout(*labels, view=[0.5 - len(rows), 0.9])
    layout["yaxis"] |= {"showticklabels": False, "showgrid": False, "fixedrange": True}
    layout |= {"xaxis": {"range": ends}, "hovermode": "closest", "margin": {"l": 10}}
    return [Plot("status over time", traces, layout, height=62 + 44 * len(rows), wide=True)]


def words(bit: Status) -> str:
    """Return the name of a status in words."""
    return str(bit.name).replace("_", " ").lower()


def _output(every: Sequence[Series], name: str, unit: str) -> Plot:
    having = [s for s in every if s.has("output", name)]
    y = having[0].signal("y", "output", name)
    estimates = [(s, s.signal("y_hat", "output", name)) for s in having]
    residuals = [(s, s.signal("y", "output", name) - y_hat) for s, y_hat in estimates]
    traces = [measured(having[0].time, y, name="measured")]
    traces += [_line(s, y_hat) for s, y_hat in estimates]
    traces += [_line(s, r, axis="y2", width=0.9) for s, r in residuals]
    title = plain(quantity(name, unit))
    layout = _layout(
        heading(title),
        heading(f"residual: measured − estimated {title}", y=0.30),
        view=view([y, *(v for _, v in estimates)], []),
    )
    layout["yaxis"] |= {"domain": [0.45, 1]}
    layout["yaxis2"] = {"domain": [0, 0.30], "range": view([r for _, r in residuals], [])}
    layout["xaxis"] = {"anchor": "y2"}
    return Plot(f"output {name}: measured and estimated", traces, layout, height=400, wide=True)


def _state(every: Sequence[Series], name: str, unit: str, reference: float | None) -> Plot:
    having = [s for s in every if s.has("state", name)]
    lines, edges, traces, estimates = [], [], [], []
    for s in having:
        x, std = s.signal("x_hat", "state", name), s.signal("x_std", "state", name)
        lines.append(x)
        edges += [x - 3.0 * std, x + 3.0 * std]
        traces.append(band(s.time, edges[-2], edges[-1], colour=f"{s.colour}-band", group=s.group))
        estimates.append(_line(s, x, std=std))
    if truth := next((s for s in having if "x_true" in s.result), None):
        x = truth.signal("x_true", "state", name)
        lines.append(x)
        estimates.append(line(truth.time, x, name="truth", colour="--ink", width=1.2, dash="dash"))
    layout = _layout(heading(plain(quantity(name, unit))))
    if reference is not None:
        lines.append(np.array([reference]))
        layout["shapes"] = [_level(reference, dash="dot")]
    layout["yaxis"] = {"range": view(lines, edges)}
    return Plot(f"state {name} over time with bands", [*traces, *estimates], layout)


def _innovation(s: Series, name: str) -> tuple[Array, Array]:
    """Innovation where it was measured, and three of its standard deviations."""
    e = np.where(np.isfinite(s.signal("y", "output", name)), s.signal("e", "output", name), np.nan)
    i = list(s.result["output"].values).index(name)
    variance = s.result["S"].values[:, i, i]
    return e, 3.0 * np.sqrt(np.where(variance > 0, variance, np.nan))


def _line(
    s: Series,
    values: Array,
    *,
    time: Array | None = None,
    width: float = 1.3,
    std: Array | None = None,
    axis: str = "y",
) -> Trace:
    return line(
        s.time if time is None else time,
        values,
        name=s.name,
        colour=s.colour,
        group=s.group,
        dash=s.dash,
        width=width,
        std=std,
        axis=axis,
    )


def _ticks(s: Series, where: Array, row: int) -> Trace:
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


def _level(value: float, *, dash: str) -> dict[str, object]:
    pen = {"color": "--ink", "width": 1.2, "dash": dash}
    ends = {"xref": "paper", "x0": 0, "x1": 1, "y0": value, "y1": value}
    return {"type": "line", "layer": "above", "line": pen, **ends}


def _layout(*labels: dict[str, object], view: list[float] | None = None) -> dict[str, object]:
    return {"annotations": list(labels), "yaxis": {"range": view}}
