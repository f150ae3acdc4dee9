"""Lines and bands in the form that plotly.js reads.

Colours are names of CSS variables (``--ink``); the page's script looks them up, so that plots
follow its light or dark scheme.
"""

import base64
import html

import numpy as np

from backsight.report.thin import envelope, thin
from backsight.types import Array

Trace = dict[str, object]


def encoded(values: Array) -> dict[str, str]:
    """Numbers as base64 of their bytes: exact, small, and with room for NaN, unlike JSON."""
    raw = np.ascontiguousarray(values, dtype="<f8").tobytes()
    return {"dtype": "f8", "bdata": base64.b64encode(raw).decode("ascii")}


def plain(text: str) -> str:
    """Text that plotly.js shows as it is: it would read tags and templates in it."""
    return html.escape(text, quote=False).replace("%{", "%&#123;")


def line(
    time: Array,
    values: Array,
    *,
    name: str,
    colour: str,
    group: str = "",
    width: float = 1.3,
    dash: str = "solid",
    std: Array | None = None,
    axis: str = "y",
) -> Trace:
    """A signal over time, thinned; hovering shows its value and three standard deviations."""
    kept = thin(values)
    trace = {
        "type": "scatter",
        "mode": "lines",
        "name": plain(name),
        "x": encoded(time[kept]),
        "y": encoded(values[kept]),
        "yaxis": axis,
        "legendgroup": group,
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": "%{y:.6~g}",
    }
    if std is None:
        return trace
    return trace | {
        "customdata": encoded(3.0 * std[kept]),
        "hovertemplate": "%{y:.6~g} ± %{customdata:.2~g}",
    }


def measured(time: Array, values: Array, *, name: str, axis: str = "y") -> Trace:
    """A measured signal: a line, or dots where most of its samples have no measured neighbour."""
    known = np.isfinite(values)
    if np.sum(known[1:] & known[:-1]) >= 0.5 * np.sum(known[1:]):
        return line(time, values, name=name, colour="--measured", width=2.5, axis=axis)
    dots = line(time[known], values[known], name=name, colour="--measured", axis=axis)
    return dots | {"mode": "markers", "marker": {"color": "--measured", "size": 4}}


def band(time: Array, lower: Array, upper: Array, *, colour: str, group: str = "") -> Trace:
    """A filled band, thinned to its envelope; limits that are not finite interrupt it."""
    kept, low, high = envelope(lower, upper)
    there = np.flatnonzero(np.isfinite(low) & np.isfinite(high))
    pieces = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
    gap = np.array([np.nan])
    x = [np.concatenate([time[kept[p]], time[kept[p]][::-1], gap]) for p in pieces]
    y = [np.concatenate([high[p], low[p][::-1], gap]) for p in pieces]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": encoded(np.concatenate(x)),
        "y": encoded(np.concatenate(y)),
        "legendgroup": group,
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": colour,
        "hoverinfo": "skip",
    }


def limits(time: Array, bound: Array, *, group: str = "") -> Trace:
    """Two thin lines at plus and minus `bound`, drawn over noise that would hide a filled band."""
    kept, _, high = envelope(-bound, bound)
    gap = np.array([np.nan])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": encoded(np.concatenate([time[kept], gap, time[kept]])),
        "y": encoded(np.concatenate([high, gap, -high])),
        "legendgroup": group,
        "line": {"color": "--ink", "width": 1},
        "hoverinfo": "skip",
    }


def view(lines: list[Array], bands: list[Array]) -> list[float] | None:
    """Vertical range that shows the lines whole and does not let a wide initial band squash them.

    Parameters
    ----------
    lines : list of array
        Signals and reference values. One whose extremes are far outside the bulk of it (a start
        value, a diverged end) counts with its bulk only.
    bands : list of array
        Limits of bands: the outermost 5 % of their samples do not count.

    Returns
    -------
    list of float, or None
        Lower and upper end; None if nothing is finite.
    """
    ranges = [r for v in lines if (r := _line_range(v))]
    ranges += [(q[0], q[1]) for v in bands if (q := _quantiles(v, 0.05))]
    if not ranges:
        return None
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return [low - margin, high + margin]


def _line_range(values: Array) -> tuple[float, float] | None:
    bulk, whole = _quantiles(values, 0.005), _quantiles(values, 0.0)
    if bulk is None or whole is None:
        return None
    far = bulk[1] > bulk[0] and whole[1] - whole[0] > 5.0 * (bulk[1] - bulk[0])
    return bulk if far else whole


def _quantiles(values: Array, tail: float) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = np.quantile(finite, [tail, 1.0 - tail])
    return float(low), float(high)
