"""Lines and bands in the form that plotly.js reads.

Colours are names of CSS variables (``--ink``); the page's script looks them up, so that plots
follow its light or dark scheme.
"""

import base64
import html

import numpy as np

from backsight.report.thin import Positions, envelope, thin
from backsight.types import Array

Trace = dict[str, object]

_DOTTED = 100  # up to so many samples, each gets a dot


def encoded(values: Array) -> dict[str, str]:
    """Numbers as base64 of their bytes: exact, small, and with room for NaN, unlike JSON."""
    raw = np.ascontiguousarray(values, dtype="<f8").tobytes()
    return {"dtype": "f8", "bdata": base64.b64encode(raw).decode("ascii")}


def literal_text(text: str) -> str:
    """Text that plotly.js shows as it is: it would read tags and templates in it."""
    return html.escape(text, quote=False).replace("%{", "%&#123;")


def line_trace(
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
    kept = drawn(values)
    trace = {
        "type": "scatter",
        "mode": "lines" if len(kept) > _DOTTED else "lines+markers",
        "name": literal_text(name),
        "x": encoded(time[kept]),
        "y": encoded(values[kept]),
        "yaxis": axis,
        "legendgroup": group,
        "line": {"color": colour, "width": width, "dash": dash},
        "marker": {"color": colour, "size": 3 + width},
        "hovertemplate": "%{y:.6~g}",
    }
    if std is None:
        return trace
    return trace | {
        "customdata": encoded(3.0 * std[kept]),
        "hovertemplate": "%{y:.6~g} ± %{customdata:.2~g}",
    }


def drawn(values: Array) -> Positions:
    """Positions of the samples to join by a line: every peak, and what is between the gaps.

    Samples that are missing now and then, or at regular intervals because the sensor is slow, are
    skipped. A gap of more than five usual intervals stays one: it keeps a sample that is missing.
    """
    there = np.flatnonzero(np.isfinite(values))
    if there.size < 2:
        return np.arange(len(values))
    steps = np.diff(there)
    gaps = there[:-1][steps > 5 * np.median(steps)] + 1
    return np.sort(np.concatenate([there[thin(values[there])], gaps]))


def band_trace(time: Array, lower: Array, upper: Array, *, colour: str, group: str = "") -> Trace:
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
    kept = drawn(bound)
    gap = np.array([np.nan])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": encoded(np.concatenate([time[kept], gap, time[kept]])),
        "y": encoded(np.concatenate([bound[kept], gap, -bound[kept]])),
        "legendgroup": group,
        "line": {"color": "--ink", "width": 1},
        "hoverinfo": "skip",
    }


def view(lines: list[Array], bands: list[Array]) -> list[float] | None:
    """Vertical range that shows the lines whole and does not let a wide initial band squash them.

    Parameters
    ----------
    lines : list of array
        Signals and reference values. Of one that starts far away from where it is later, the first
        2 % of the samples do not count; a later peak always does.
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


def bulk(values: Array) -> Array:
    """Range of the finite values without the outermost 0.5 % on either side: (2,), or empty."""
    return np.array(_quantiles(values, 0.005) or [])


def _line_range(values: Array) -> tuple[float, float] | None:
    whole, later = (_quantiles(v, 0.0) for v in (values, values[len(values) // 50 :]))
    if whole is None or later is None:
        return whole
    far = later[1] > later[0] and whole[1] - whole[0] > 5.0 * (later[1] - later[0])
    return later if far else whole


def _quantiles(values: Array, tail: float) -> tuple[float, float] | None:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    low, high = np.quantile(finite, [tail, 1.0 - tail])
    return float(low), float(high)
