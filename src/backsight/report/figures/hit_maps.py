"""Unknown forces on the page: maps over place and time, and tables of the largest hits."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np
import xarray as xr

from backsight.analysis.comparison import Row
from backsight.analysis.forces import FoundHits, forces, where
from backsight.report._html_tables import swatch, table
from backsight.report._series import Plot, Series, quantity
from backsight.report._theme import heading, remark
from backsight.report._traces import Trace, encoded, literal_text
from backsight.report.thin import peaks
from backsight.rounding import grouped, plus_minus, significant
from backsight.types import Array

NOTE = (
    "<p>Force over place and time, with the largest hits in circles. Neighbouring steps at one "
    "place are one hit; σ is the standard deviation. Where an estimator gives a force to every "
    "sample, a hit is what chance alone would reach in one recording of a hundred.</p>"
)

MOST_HITS = 12
"""Rows of a table, and circles in a map."""

_COLUMNS = 400  # steps of a map: fewer than pixels, or short hits would not be seen
_SMALLEST, _LARGEST = 9.0, 26.0  # diameters of the circles [px]
_ROW, _MOST_LABELS = 26, 16  # height of a place [px], and how many are named
_COLOURS = [[0.0, "--series-0"], [0.5, "--paper"], [1.0, "--series-1"]]


def force_maps(rows: Sequence[Row], every: Sequence[Series]) -> list[Plot]:
    """One map per estimator that found forces: place over time, force in colour."""
    found = [(s, forces(s.result)[0], hits) for s, _, hits in _found(rows, every)]
    return [_map(s, held, hits) for s, held, hits in found if held.values.any()]


def hit_tables(rows: Sequence[Row], every: Sequence[Series]) -> str:
    """Return the largest hits of every estimator that looks for forces, or why there are none.

    Behind them those that were fitted as pulses.
    """
    found = _found(rows, every)
    largest = "".join(_table(s, row, hits) for s, row, hits in found)
    return largest + "".join(_fitted(s, row) for s, row, _ in found if row.fitted_hits)


def _fitted(s: Series, row: Row) -> str:
    numbers = row.fitted_hits[0].numbers
    head = ["place"] + [f"{n} ± σ<small>{escape(v.unit)}</small>" for n, v in numbers.items()]
    body = [
        [
            escape(hit.force or str(i)),
            *(plus_minus(v.value, v.std or math.nan) for v in hit.numbers.values()),
        ]
        for i, hit in enumerate(row.fitted_hits, 1)
    ]
    caption = f"{swatch(s)}{escape(s.name)}: hits fitted as pulses, in the order of time"
    return table("hits", head, body, caption=caption)


def _found(rows: Sequence[Row], every: Sequence[Series]) -> list[tuple[Series, Row, FoundHits]]:
    by_name = {row.estimator: row for row in rows}
    having = [(s, by_name[s.name]) for s in every]
    return [(s, row, row.hits) for s, row in having if row.hits is not None]


def _table(s: Series, row: Row, found: FoundHits) -> str:
    name = f"{swatch(s)}{escape(s.name)}"
    if not found.hits:
        why = "; ".join(row.remarks) or "no force is larger than chance would make it"
        return f"<p>{name}: {escape(why)}.</p>"
    unit = found.unit
    head = ["", "place", "time<small>s</small>", f"force ± σ<small>{escape(unit)}</small>"]
    head += [f"impulse ± σ<small>{escape(f'{unit} s'.strip())}</small>"]
    head += ["duration<small>ms</small>"]
    body = [
        [
            str(rank),
            escape(hit.where),
            f"{hit.impact.time:.6g}",
            plus_minus(hit.force, hit.std),
            plus_minus(hit.impact.impulse, hit.impact.std or math.nan),
            significant(1e3 * (hit.impact.end - hit.impact.start), 3),
        ]
        for rank, hit in enumerate(found.hits[:MOST_HITS], 1)
    ]
    count = len(found.hits)
    shown = f"{len(body)} largest of {grouped(count)} hits" if count > len(body) else "all hits"
    return table("hits", head, body, caption=f"{name}: {shown}, the largest impulse first")


def _map(s: Series, held: xr.DataArray, found: FoundHits) -> Plot:
    labels = [literal_text(label) for label in where(s.result)]
    shown = found.hits[:MOST_HITS]
    traces = [_heat(s, held.values, labels, found.unit), *([_circles(s, found)] if shown else [])]
    axis = "place (position [m])" if "force_position" in held.coords else "place"
    every = -(-len(labels) // _MOST_LABELS)
    layout = {
        "annotations": [
            heading(literal_text(f"{s.name}: {quantity('force', found.unit)} over {axis}")),
            *([remark("○ the largest hits")] if shown else []),
        ],
        "yaxis": {
            "type": "category",
            "tickmode": "linear",
            "dtick": every,
        },
        "hovermode": "closest",
    }
    height = 110 + _ROW * min(max(len(labels), 3), _MOST_LABELS)
    label = f"unknown forces over place and time, {s.name}"
    return Plot(label, traces, layout, height=height, wide=True)


def _heat(s: Series, held: Array, labels: Sequence[str], unit: str) -> Trace:
    kept, length = peaks(held, _COLUMNS)
    dt = float(s.result.attrs["dt"])
    largest = float(np.abs(kept).max(initial=0.0)) or 1.0
    return {
        "type": "heatmap",
        # Cells have their centre in the middle of the interval in which the force acts.
        "x0": s.time[0] + 0.5 * length * dt,
        "dx": length * dt,
        "y": list(labels),
        "z": encoded(np.where(kept.T == 0, np.nan, kept.T))
        | {"shape": f"{kept.shape[1]}, {kept.shape[0]}"},
        "zmin": -largest,
        "zmax": largest,
        "hoverongaps": False,
        "colorscale": _COLOURS,
        "colorbar": {"thickness": 10, "outlinewidth": 0, "nticks": 5, "tickfont": {"size": 10.5}},
        "legendgroup": s.group,
        "hovertemplate": (
            f"%{{y}}<br>%{{x:.6~g}} s<br>%{{z:.4~g}} {literal_text(unit)}<extra></extra>"
        ),
    }


def _circles(s: Series, found: FoundHits) -> Trace:
    shown = found.hits[:MOST_HITS]
    size = np.sqrt([abs(hit.force) for hit in shown])
    unit = f" {found.unit}" if found.unit else ""
    return {
        "type": "scatter",
        "mode": "markers",
        "x": encoded(np.array([hit.impact.time for hit in shown])),
        "y": [literal_text(hit.where) for hit in shown],
        "text": [literal_text(f"{plus_minus(hit.force, hit.std)}{unit}") for hit in shown],
        "marker": {
            "symbol": "circle-open",
            "color": "--ink",
            "line": {"width": 1.4},
            "size": (_SMALLEST + (_LARGEST - _SMALLEST) * size / size.max()).tolist(),
        },
        "legendgroup": s.group,
        "hovertemplate": "%{y}<br>%{x:.6~g} s<br>%{text}<extra></extra>",
    }
