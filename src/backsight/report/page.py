"""The report: one HTML page that needs nothing but itself."""

import base64
import dataclasses
import gzip
import json
import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import xarray as xr

from backsight.analysis.comparison import Row, ranked_table
from backsight.errors import DataError
from backsight.output import write_whole
from backsight.report import _html_tables as tables
from backsight.report._answers import answers, asked, judgements
from backsight.report._plots import (
    innovation_plots,
    input_plots,
    nis_plot,
    output_plots,
    status_plots,
)
from backsight.report._series import Plot, Series, series, signal_units
from backsight.report._theme import TEMPLATE
from backsight.report.figures.bands import state_plots, virtual_plots
from backsight.report.figures.hit_maps import NOTE, force_maps, hit_tables
from backsight.report.figures.profiles import profile_drawings
from backsight.report.palette import ON_DARK, ON_LIGHT, series_variables
from backsight.report.thin import POINTS, interval_length
from backsight.rounding import grouped


def write_page(
    results: Mapping[str, xr.Dataset],
    path: str | os.PathLike[str],
    *,
    problem: str | Mapping[str, object] | None,
    title: str | None,
    reference: Mapping[str, float] | None,
    profiles: xr.Dataset | None,
) -> Path:
    """Write the page, see `backsight.report.report`."""
    if not results:
        raise DataError("there are no results to report: give at least one")
    rows = ranked_table(results, reference)
    every = series(results)
    sections = _sections(rows, every, reference or {})
    if profiles is not None:
        sections.append(Section("Tuning", profile_drawings(profiles)))
    plots = [plot for section in sections for plot in section.plots]
    heading = title or str(every[0].result.attrs.get("model", "Estimates"))
    page = Template(_resource("page.html")).substitute(
        title=escape(heading),
        style=style(),
        facts=escape(_facts(every[0].result)),
        judgements=judgements(rows, every),
        answers=answers(rows, every, reference or {}),
        contents=_contents(sections),
        legend=_legend(every, bool(reference)),
        sections="".join(map(str, sections)) + _problem(problem),
        notes=_notes(every),
        plotly=gzipped(_plotly_js()),
        figures=gzipped(_data(plots, every)),
        script=_resource("page.js"),
    )
    return write_whole(path, page.encode("utf-8"))


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the page: a heading, text, plots, and what stands below them."""

    name: str
    text: str = ""
    plots: Sequence[Plot] = ()
    below: str = ""

    @property
    def anchor(self) -> str:
        """Where links lead to."""
        return self.name.lower().replace(" ", "-")

    def __str__(self) -> str:
        grid = f'<div class="plots">{"".join(map(_place, self.plots))}</div>' if self.plots else ""
        return (
            f'<details open class="section" id="{self.anchor}"><summary><h2>{self.name}</h2>'
            f"</summary>{self.text}{grid}{self.below}</details>"
        )


def _sections(
    rows: Sequence[Row], every: Sequence[Series], reference: Mapping[str, float]
) -> list[Section]:
    """Return pictures first, what was asked for before what moves, and statistics behind."""
    states, outputs = signal_units(every, "state"), signal_units(every, "output")
    maps = force_maps(rows, every)
    first = [name for name in asked(every) if len(asked(every)) < len(states)]
    moving = [name for name in states if name not in first]
    happened = status_plots(every)
    bands = "<p>Lines are estimates, bands three standard deviations either way.</p>"
    found = [
        Section("Unknown forces", NOTE if maps else "", maps, hit_tables(rows, every)),
        Section("Where no sensor is", tables.virtual_table(rows, every), virtual_plots(every)),
        Section("Unknowns", bands, state_plots(every, reference, first)),
        Section("States", "" if first else bands, state_plots(every, reference, moving)),
        Section("Measured and estimated", "", output_plots(every)),
        Section("Inputs", "", input_plots(every)),
        Section("Values", tables.final_values_table(rows, every, states)),
        Section(
            "Innovations",
            "<p>Measurement minus its one-step prediction. Of a consistent estimator, 99.7 % lie "
            "between the lines at three standard deviations, without a pattern.</p>",
            innovation_plots(every),
        ),
        Section(
            "Consistency",
            "<p>Innovations measured with their own covariance. Of a consistent estimator, 95 % "
            "lie in the band; above it the estimator is over-confident, below it too cautious. "
            "They are neither correlated with each other nor explained by inputs.</p>"
            + tables.consistency_table(rows, every),
            [nis_plot(every)],
        ),
        Section("Comparison", tables.comparison(rows, every, outputs)),
        Section("Status", tables.status_list(rows) if happened else "", happened),
    ]
    return [s for s in found if s.plots or s.below or (s.text and s.text != bands)]


def _contents(sections: Sequence[Section]) -> str:
    return "".join(f'<a href="#{s.anchor}">{s.name}</a>' for s in sections)


def _place(plot: Plot) -> str:
    kind = "wide" if plot.wide else "first" if plot.first else ""
    label, style = escape(plot.label), f"height: {plot.height}px"
    return f'<figure class="{kind}" role="group" aria-label="{label}" style="{style}"></figure>'


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


def _notes(every: Sequence[Series]) -> str:
    longest = max(len(s.time) for s in every)
    linked = (
        "Drag to zoom; all plots share the time axis. Double-click to zoom out, and again for the "
        "whole vertical range: at first it leaves out wide bands, far starts and rare innovations."
    )
    if longest <= POINTS:
        return f"<p>{linked} The plots show every sample.</p>"
    length = interval_length(longest)
    return (
        f"<p>{linked} The recording is too long to draw every sample: the plots show the smallest "
        f"and largest of every {length} samples, so no peak is lost, but zooming in does not "
        "bring out more. The tables use all samples.</p>"
    )


def _data(plots: Sequence[Plot], every: Sequence[Series]) -> str:
    data = {
        "template": TEMPLATE,
        "span": [min(s.time[0] for s in every), max(s.time[-1] for s in every)],
        "figures": [{"traces": p.traces, "layout": p.layout} for p in plots],
    }
    return json.dumps(data, separators=(",", ":"))


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
