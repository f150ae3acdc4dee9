"""The report: one HTML page that needs nothing but itself."""

import base64
import gzip
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Literal, TypeAlias

import xarray as xr

from backsight.analysis.comparison import ranked_table
from backsight.errors import DataError
from backsight.output import write_whole
from backsight.report import _html_tables as tables
from backsight.report._answers import answers, judgements
from backsight.report._details import Detail, thinning
from backsight.report._sections import Section, contents, sections
from backsight.report._series import Plot, Series, series
from backsight.report._theme import TEMPLATE
from backsight.report.figures.profiles import profile_drawings
from backsight.report.palette import ON_DARK, ON_LIGHT, series_variables
from backsight.report.thin import POINTS, interval_length
from backsight.rounding import grouped

Library: TypeAlias = Literal["inside", "beside"]
"""Where plotly.js is: in the page, or in a file beside it."""


def write_page(
    results: Mapping[str, xr.Dataset],
    path: str | os.PathLike[str],
    *,
    problem: str | Mapping[str, object] | None,
    title: str | None,
    reference: Mapping[str, float] | None,
    profiles: xr.Dataset | None,
    library: Library,
) -> Path:
    """Write the page, see `backsight.report.report`."""
    if not results:
        raise DataError("there are no results to report: give at least one")
    rows = ranked_table(results, reference)
    every = series(results)
    shown = sections(rows, every, reference or {})
    if profiles is not None:
        shown.append(Section("Tuning", profile_drawings(profiles)))
    plots = [plot for section in shown for plot in section.plots]
    figures, details = _figures(plots)
    drawn, drawing = gzipped(_data(figures, every)), _library(library, Path(path))
    thinned = thinning(details, len(drawn) + len(drawing))
    heading = title or str(every[0].result.attrs.get("model", "Estimates"))
    page = Template(_resource("page.html")).substitute(
        title=escape(heading),
        style=style(),
        facts=escape(_facts(every[0].result)),
        judgements=judgements(rows, every),
        answers=answers(rows, every, reference or {}),
        contents=contents(shown),
        legend=_legend(every, bool(reference)),
        sections="".join(map(str, shown)) + _problem(problem),
        notes=_notes(every, thinned),
        origin=" 'self' file:" if library == "beside" else "",
        library=drawing,
        figures=drawn,
        details=gzipped(_details(details, thinned, every)),
        script=_resource("page.js"),
    )
    return write_whole(path, page.encode("utf-8"))


def _problem(problem: str | Mapping[str, object] | None) -> str:
    if problem is None:
        return ""
    text = problem if isinstance(problem, str) else json.dumps(problem, indent=2, default=str)
    return f"<details><summary>The problem as read</summary><pre>{escape(text)}</pre></details>"


def _legend(every: Sequence[Series], reference: bool) -> str:
    items = [
        f'<button type="button" data-group="{s.group}" aria-pressed="true" '
        f'title="show or hide">{tables.swatch(s)}{escape(s.name)}</button>'
        for s in every
    ]
    items.append(_key("border-top: 3px solid var(--measured)", "measured"))
    if any("x_true" in s.result for s in every):
        items.append(_key("border-top: 2px dashed var(--ink)", "truth"))
    if reference:
        items.append(_key("border-top: 2px dotted var(--ink)", "reference"))
    items.append('<span class="key"><i class="stroke area"></i>±3σ</span>')
    items.append(
        '<span class="tools"><button type="button" id="drag" aria-pressed="false">drag to zoom'
        '</button><button type="button" id="reset">reset zoom</button></span>'
    )
    return "".join(items)


def _key(stroke: str, text: str) -> str:
    return f'<span class="key"><i class="stroke" style="{stroke}"></i>{text}</span>'


def _facts(result: xr.Dataset) -> str:
    time = result["time"].values
    facts = [f"{grouped(len(time))} sample{'s' * (len(time) != 1)}"]
    if "dt" in result.attrs:
        facts[0] += f" every {1e3 * float(result.attrs['dt']):g} ms"
    if len(time) > 1:
        facts.append(f"{time[-1] - time[0]:g} s")
    share = result["y"].notnull().values.mean(axis=0)
    seen = [
        f"{name} {100 * part:.3g} %"
        for name, part in zip(result["output"].values, share, strict=True)
        if part < 1
    ]
    facts += [f"measured: {', '.join(seen)}"] if seen else []
    return " · ".join(facts)


def _notes(every: Sequence[Series], thinned: int) -> str:
    longest = max(len(s.time) for s in every)
    linked = (
        "Drag to zoom; all plots share the time axis. Double-click to zoom out, and again for the "
        "whole vertical range: at first it leaves out wide bands, far starts and rare innovations."
    )
    handling = f'<p class="handling">{linked}</p>'  # nobody can on paper
    if longest <= POINTS:
        return f"{handling}<p>The plots show every sample.</p>"
    length = interval_length(longest)
    out = "every sample" if thinned == 1 else f"the smallest and largest of every {thinned} samples"
    if thinned >= length:
        out = "no more, for want of room"
    return (
        f"{handling}<p>The recording is too long to draw every sample at once: the plots show the "
        f"smallest and largest of every {length} samples, so no peak is lost, and zooming in "
        f"brings out {out}, and so do the CSV files. Where samples are not evenly spaced it does "
        "not. The tables use all samples.</p>"
    )


def _figures(plots: Sequence[Plot]) -> tuple[list[dict[str, object]], list[Detail]]:
    """Figures as plotly.js takes them; in place of its detail, a trace has the detail's number."""
    details: list[Detail] = []
    figures: list[dict[str, object]] = []
    for plot in plots:
        traces = [dict(trace) for trace in plot.traces]
        for trace in traces:
            detail = trace.pop("detail", None)
            if isinstance(detail, Detail):
                trace["detail"] = len(details)
                details.append(detail)
        figures.append({"traces": traces, "layout": plot.layout, "over": plot.over})
    return figures, details


def _details(details: Sequence[Detail], thinned: int, every: Sequence[Series]) -> str:
    """All details; none if there is room for no more than the plots show anyway."""
    some = thinned < interval_length(max(len(s.time) for s in every))
    found = [d.packed(thinned) for d in details] if some else []
    return json.dumps(found, separators=(",", ":"))


def _data(figures: Sequence[Mapping[str, object]], every: Sequence[Series]) -> str:
    data = {
        "template": TEMPLATE,
        "span": [min(s.time[0] for s in every), max(s.time[-1] for s in every)],
        "figures": figures,
    }
    return json.dumps(data, separators=(",", ":"))


def _library(library: Library, page: Path) -> str:
    """What brings plotly.js: itself, packed, or a file beside the page that many pages share."""
    text = _plotly_js()
    if library == "inside":
        return f'<script type="application/gzip" id="plotly">{gzipped(text)}</script>'
    name = f"backsight-plotly-{hashlib.sha256(text.encode()).hexdigest()[:12]}.js"
    if not (page.parent / name).is_file():
        write_whole(page.parent / name, text.encode("utf-8"))
    return f'<script src="{name}"></script>'


def style() -> str:
    """What pages look like, in both themes and on paper."""
    return Template(_resource("page.css")).substitute(
        light=series_variables(ON_LIGHT, band=0.16), dark=series_variables(ON_DARK, band=0.22)
    )


def gzipped(text: str) -> str:
    """Return text as base64 of its gzip, which the page's script unpacks: nothing in it is HTML."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), mtime=0)).decode("ascii")


def _plotly_js() -> str:
    """The part of plotly.js that draws over two axes: a third of the whole."""
    return _resource("plotly-cartesian.min.js")


def _resource(name: str) -> str:
    return files("backsight.report").joinpath(name).read_text(encoding="utf-8")
