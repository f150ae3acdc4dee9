"""Lines and bands in the form that plotly.js reads.

Colours are names of CSS variables (``--ink``); the page's script looks them up, so that plots
follow its light or dark scheme.
"""

import base64
import html
from typing import Literal

import numpy as np

from backsight.report._details import Detail
from backsight.report.thin import POINTS, Positions, envelope, thin
from backsight.types import Array

Trace = dict[str, object]

_SINGLE, _VARIES = 1e37, 1e-3  # largest number, and least relative range, in single precision
_DOTTED = 100  # up to so many samples, each gets a dot


def encoded(values: Array) -> dict[str, str]:
    """Numbers as base64 of their bytes: small, and with room for NaN, unlike JSON.

    Single precision draws a signal exactly enough unless it varies little about a large value.
    """
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max(initial=0.0))
    fine = finite.size == 0 or (largest < _SINGLE and float(np.ptp(finite)) > _VARIES * largest)
    kind = "f4" if fine else "f8"
    raw = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(raw).decode("ascii")}


def even_step(time: Array) -> float | None:
    """Time between two samples; None if they are not evenly spaced."""
    step = (time[-1] - time[0]) / max(len(time) - 1, 1)
    even = np.abs(time - (time[0] + step * np.arange(len(time)))).max() <= 0.01 * step
    return float(step) if even and step > 0 else None


def moments(time: Array, kept: Positions) -> dict[str, object]:
    """Times of some samples: their numbers if the samples are evenly spaced, which is small.

    The largest number stands for a gap; the page's script turns numbers into times.

    Parameters
    ----------
    time : (n,) array
        Of all samples.
    kept : array of int
        Positions; negative where the line is interrupted.
    """
    step = even_step(time)
    if step is None:
        at = np.where(kept < 0, np.nan, time[kept])
        raw = np.ascontiguousarray(at, dtype="<f8").tobytes()
        return {"dtype": "f8", "bdata": base64.b64encode(raw).decode("ascii")}
    kind = "u2" if len(time) < 2**16 - 1 else "u4"
    largest = np.iinfo(kind).max
    raw = np.where(kept < 0, largest, kept).astype(f"<{kind}").tobytes()
    places = {"dtype": kind, "bdata": base64.b64encode(raw).decode("ascii")}
    return {"start": float(time[0]), "step": step, "places": places}


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
        "x": moments(time, kept),
        "y": encoded(values[kept]),
        "yaxis": axis,
        "legendgroup": group,
        "line": {"color": colour, "width": width, "dash": dash},
        "marker": {"color": colour, "size": 3 + width},
        "hovertemplate": "%{y:.6~g}",
        **_detail("line", time, values, gaps=kept[~np.isfinite(values[kept])]),
    }
    if std is None:
        return trace
    return trace | {
        "customdata": encoded(3.0 * std[kept]),
        "hovertemplate": "%{y:.6~g} ± %{customdata:.2~g}",
    }


def _detail(
    kind: Literal["line", "band", "limits"],
    time: Array,
    *values: Array,
    gaps: Positions | None = None,
) -> dict[str, Detail]:
    """What zooming in brings out, under the key ``detail``; nothing if every sample is drawn."""
    step = even_step(time)
    if len(time) <= POINTS or step is None:
        return {}
    none = np.zeros(0, dtype=np.intp)
    return {"detail": Detail(kind, values, float(time[0]), step, none if gaps is None else gaps)}


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
    gap, nowhere = np.array([np.nan]), np.array([-1])
    x = [np.concatenate([kept[p], kept[p][::-1], nowhere]) for p in pieces]
    y = [np.concatenate([high[p], low[p][::-1], gap]) for p in pieces]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": moments(time, np.concatenate(x)),
        "y": encoded(np.concatenate(y)),
        "legendgroup": group,
        "line": {"width": 0},
        "fill": "toself",
        "fillcolor": colour,
        "hoverinfo": "skip",
        **_detail("band", time, lower, upper),
    }


def limits(time: Array, bound: Array, *, group: str = "") -> Trace:
    """Two thin lines at plus and minus `bound`, drawn over noise that would hide a filled band."""
    kept = drawn(bound)
    gap = np.array([np.nan])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": moments(time, np.concatenate([kept, [-1], kept])),
        "y": encoded(np.concatenate([bound[kept], gap, -bound[kept]])),
        "legendgroup": group,
        "line": {"color": "--ink", "width": 1},
        "hoverinfo": "skip",
        **_detail("limits", time, bound),
    }
