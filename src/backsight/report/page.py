"""The report: one HTML page that needs nothing but itself."""

import json
import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import xarray as xr

from backsight.analysis.comparison import Row, ranked_table, verdicts
from backsight.errors import DataError
from backsight.output import write_whole
from backsight.report import _html_tables as tables
from backsight.report._bands import state_plots, virtual_plots
from backsight.report._hit_maps import NOTE, force_maps, hit_tables
from backsight.report._plots import (
    innovation_plots,
    input_plots,
    nis_plot,
    output_plots,
    status_plots,
)
from backsight.report._series import Plot, Series, series, signal_units
from backsight.report._theme import TEMPLATE
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
) -> Path:
    """Write the page, see `backsight.report.report`."""
    if not results:
        raise DataError("there are no results to report: give at least one")
    rows = ranked_table(results, reference)
    every = series(results)
    sections = _sections(rows, every, reference or {}, problem)
    plots = [plot for _, group in sections for plot in group]
    heading = title or str(every[0].result.attrs.get("model", "Estimates"))
    page = Template(_resource("page.html")).substitute(
        title=escape(heading),
        style=_style(),
        facts=escape(_facts(every[0].result)),
        verdicts="".join(f"<li>{escape(v)}</li>" for v in verdicts(rows)),
        legend=_legend(every, bool(reference)),
        sections="".join(text for text, _ in sections),
        notes=_notes(every),
        plotly=_plotly_js(),
        figures=_data(plots, every),
        script=_resource("page.js"),
    )
    return write_whole(path, page.encode("utf-8"))


Section = tuple[str, Sequence[Plot]]


def _sections(
    rows: Sequence[Row],
    every: Sequence[Series],
    reference: Mapping[str, float],
    problem: str | Mapping[str, object] | None,
) -> list[Section]:
    states, outputs = signal_units(every, "state"), signal_units(every, "output")
    compared = tables.comparison(rows, every, outputs) + tables.final_values_table(
        rows, every, states
    )
    happened = tables.status_list(rows)
    maps = force_maps(rows, every)
    found = [
        _section("Comparison", compared, []),
        _section("Unknown forces", NOTE if maps else "", maps, below=hit_tables(rows, every)),
        _section("Measured and estimated", "", output_plots(every)),
        _section("Inputs", "", input_plots(every)),
        _section(
            "States and parameters",
            "<p>Lines are estimates, bands three standard deviations either way.</p>",
            state_plots(every, reference),
        ),
        _section(
            "Where no sensor is",
            tables.virtual_table(rows, every),
            virtual_plots(every),
        ),
        _section(
            "Innovations",
            "<p>Measurement minus its one-step prediction. Of a consistent estimator, 99.7 % lie "
            "between the lines at three standard deviations, without a pattern.</p>",
            innovation_plots(every),
        ),
        _section(
            "Consistency",
            "<p>Innovations measured with their own covariance. Of a consistent estimator, 95 % "
            "lie in the band; above it the estimator is over-confident, below it too cautious. "
            "They are neither correlated with each other nor explained by inputs.</p>"
            + tables.consistency_table(rows, every),
            [nis_plot(every)],
        ),
    ]
    if status := status_plots(every):
        found.append(_section("Status", happened, status))
    found = [(text, plots) for text, plots in found if text]
    return [*found, (_problem(problem), [])]


def _section(name: str, text: str, plots: Sequence[Plot], *, below: str = "") -> Section:
    if not (plots or text or below):
        return "", []
    grid = f'<div class="plots">{"".join(map(_place, plots))}</div>' if plots else ""
    return f"<section><h2>{name}</h2>{text}{grid}{below}</section>", plots


def _place(plot: Plot) -> str:
    kind = "wide" if plot.wide else "first" if plot.first else ""
    label, style = escape(plot.label), f"height: {plot.height}px"
    return f'<figure class="{kind}" role="img" aria-label="{label}" style="{style}"></figure>'


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
    text = json.dumps(data, separators=(",", ":"))
    # Inside a script element only "<" could end the data early.
    return text.replace("<", "\\u003c")


def _style() -> str:
    return Template(_resource("page.css")).substitute(
        light=series_variables(ON_LIGHT, band=0.16), dark=series_variables(ON_DARK, band=0.22)
    )


def _plotly_js() -> str:
    """The drawing library that plotly ships; plotly itself is slow to import and not needed."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text("utf-8")


def _resource(name: str) -> str:
    return files("backsight.report").joinpath(name).read_text(encoding="utf-8")
