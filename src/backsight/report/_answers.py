"""The first screen: what was asked for, with bands, and whether it is to be believed."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from backsight.analysis.comparison import Light, Row, light, ranking_sentence, sentence
from backsight.report._html_tables import swatch
from backsight.report._series import Series, signal_units
from backsight.report.ranges import view
from backsight.report.thin import envelope, thin
from backsight.rounding import plus_minus, shortest, significant
from backsight.schema import ROLE, UNKNOWN, VIRTUAL, VIRTUAL_STD
from backsight.types import Array

MOST = 12
"""Cards on the first screen; what is more stands in the tables."""

_FEW = 6  # states that are shown where nothing unknown was asked for
_WIDTH, _HEIGHT, _POINTS = 200.0, 44.0, 160  # of a sparkline [px], and its points
_WORDS: dict[Light, str] = {
    "good": "to be believed",
    "fair": "with reservations",
    "bad": "not to be believed",
}


def judgements(rows: Sequence[Row], every: Sequence[Series]) -> str:
    """Return a light and a sentence per estimator; what several have in common is said once."""
    marks = {s.name: swatch(s) for s in every}
    said: dict[tuple[Light, str], list[str]] = {}
    for row in rows:
        said.setdefault((light(row), sentence(row)), []).append(row.estimator)
    items = [
        f"<li>{lamp(colour)}<b>{', '.join(f'{marks[n]}{escape(n)}' for n in names)}</b>: "
        f"{escape(text)}.</li>"
        for (colour, text), names in said.items()
    ]
    first = [escape(text) for text in rows[0].alignment]
    if len(rows) > 1:
        first.insert(0, escape(ranking_sentence(rows)))
    rest = "".join(f'<li class="aside">{text}</li>' for text in first)
    return f'<ul class="verdicts">{"".join(items)}{rest}</ul>'


def answers(rows: Sequence[Row], every: Sequence[Series], reference: Mapping[str, float]) -> str:
    """Return cards of what was asked for: value, band, course, light.

    Quantities without a sensor, unknown parameters and forces.
    """
    names = asked(every)
    units = signal_units(every, "state")
    best = {row.estimator: rank for rank, row in enumerate(rows)}
    having = sorted(every, key=lambda s: best[s.name])
    cards = [
        _card(name, units[name], [s for s in having if s.has("state", name)], rows, reference)
        for name in names[:MOST]
    ]
    virtual = signal_units(every, "virtual")
    shown = list(virtual)[:MOST]
    cards[:0] = [
        _virtual_card(name, virtual[name], [s for s in having if s.has("virtual", name)], rows)
        for name in shown
    ]
    if hits := _hits_card(rows):
        cards.insert(0, hits)
    more = max(len(names) - MOST, 0) + len(virtual) - len(shown)
    note = f"<p>{more} more below.</p>" if more > 0 else ""
    if not cards:
        return ""
    return f'<h2 class="unseen">Answers</h2><div class="answers">{"".join(cards)}</div>{note}'


def asked(every: Sequence[Series]) -> list[str]:
    """Names of the unknowns; of the first states, if there are none."""
    names = list(signal_units(every, "state"))
    unknown = {
        str(n)
        for s in every
        if ROLE in s.result.coords
        for n, role in zip(s.result["state"].values, s.result[ROLE].values, strict=True)
        if role == UNKNOWN
    }
    return [n for n in names if n in unknown] or names[:_FEW]


def lamp(colour: Light) -> str:
    """Return a traffic light: a colour, a shape and a word for it."""
    word = _WORDS[colour]
    return f'<i class="lamp {colour}" role="img" aria-label="{word}" title="{word}"></i>'


def _card(
    name: str,
    unit: str,
    having: Sequence[Series],
    rows: Sequence[Row],
    reference: Mapping[str, float],
) -> str:
    by_name = {row.estimator: row for row in rows}
    first = having[0]
    row = by_name[first.name]
    final = row.final.get(name)
    value = final.shown if final else "unknown"
    others = "".join(
        f"<li>{swatch(s)}{escape(s.name)} {f.shown}</li>"
        for s in having
        if (f := by_name[s.name].final.get(name))
    )
    known = f"<small>known: {shortest(reference[name])}</small>" if name in reference else ""
    return (
        f"<article><h3>{lamp(_trust(row, name))}{escape(name)} <small>{escape(unit)}</small></h3>"
        f'<p class="value">{value}</p>{_course(first, name, ("state", "x_hat", "x_std"))}'
        f"<ul>{others if len(having) > 1 else ''}</ul>{known}</article>"
    )


def _virtual_card(name: str, unit: str, having: Sequence[Series], rows: Sequence[Row]) -> str:
    """Return a quantity without a sensor: its size over the recording, with its typical band."""
    by_name = {row.estimator: row for row in rows}
    first = having[0]
    sizes = {s.name: by_name[s.name].virtual[name] for s in having}
    texts = {who: plus_minus(v.rms, v.typical_std) for who, v in sizes.items()}
    others = "".join(f"<li>{swatch(s)}{escape(s.name)} {texts[s.name]}</li>" for s in having)
    return (
        f"<article><h3>{lamp(light(by_name[first.name]))}{escape(name)} "
        f"<small>{escape(unit)}</small></h3>"
        f'<p class="value">{texts[first.name]}</p>'
        f"{_course(first, name, ('virtual', VIRTUAL, VIRTUAL_STD))}"
        f"<ul>{others if len(having) > 1 else ''}</ul><small>RMS; no sensor</small></article>"
    )


def _trust(row: Row, name: str) -> Light:
    """Light of one quantity: that of its estimator, which a doubt about the name may dim."""
    final = row.final.get(name)
    if row.failed or final is None or not np.isfinite(final.value):
        return "bad"
    whole = light(row)
    if row.doubts and whole == "fair":
        return "fair" if any(name in doubt for doubt in row.doubts) else "good"
    return whole


def _hits_card(rows: Sequence[Row]) -> str:
    """Return the largest hits of the first estimator that found some."""
    row = next((r for r in rows if r.hits is not None and r.hits.hits and not r.failed), None)
    if row is None or row.hits is None:
        return ""
    unit = row.hits.unit
    items = "".join(
        f"<li>{hit.impact.time:.5g} s, {escape(hit.where)}: "
        f"{_unbroken(f'{plus_minus(hit.force, hit.std)} {escape(unit)}')}</li>"
        for hit in row.hits.hits[:4]
    )
    count = len(row.hits.hits)
    if row.fitted_hits:  # between the places and the samples, of which there are fewer
        items = "".join(f"<li>{escape(str(hit))}</li>" for hit in row.fitted_hits[:4])
        count = len(row.fitted_hits)
    return (
        f"<article><h3>{lamp(light(row))}hits <small>{escape(row.estimator)}</small></h3>"
        f'<p class="value">{count}</p><ul>{items}</ul></article>'
    )


def _unbroken(text: str) -> str:
    """Return a text that stays in one line of a narrow card."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _course(s: Series, name: str, of: tuple[str, str, str]) -> str:
    """Return the course of an estimate in its band, as a small drawing without axes.

    Of a dimension, and its variables of values and deviations.
    """
    dim, value, deviation = of
    x, std = s.signal(value, dim, name), s.signal(deviation, dim, name)
    kept = thin(x, _POINTS)
    at, low, high = envelope(x - 3.0 * std, x + 3.0 * std, _POINTS)
    span = view([x], [low, high])
    if span is None:
        return ""
    time = s.time
    line = _path(time[kept], x[kept], time, span)
    there = np.isfinite(low) & np.isfinite(high)
    edge = np.concatenate([low[there], high[there][::-1]])
    around = np.concatenate([time[at[there]], time[at[there]][::-1]])
    band = _path(around, edge, time, span)
    label = f"course of {escape(name)}: from {significant(x[0], 3)} to {significant(x[-1], 3)}"
    return (
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" aria-label="{label}" '
        f'preserveAspectRatio="none"><path d="{band}Z" fill="var({s.colour}-band)"/>'
        f'<path d="{line}" fill="none" stroke="var({s.colour})" stroke-width="1.6" '
        'vector-effect="non-scaling-stroke"/></svg>'
    )


def _path(t: Array, values: Array, time: Array, span: Sequence[float]) -> str:
    """Return the ``d`` of an SVG path; what lies outside the range is cut."""
    length = time[-1] - time[0] or 1.0
    x = (t - time[0]) / length * _WIDTH
    y = (span[1] - np.clip(values, span[0], span[1])) / (span[1] - span[0]) * _HEIGHT
    finite = np.isfinite(y)
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x[finite], y[finite], strict=True)]
    return f"M{' L'.join(points)}" if points else "M0 0"
