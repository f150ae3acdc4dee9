"""What the page shows, in its order: answers with pictures before statistics."""

import dataclasses
from collections.abc import Mapping, Sequence
from html import escape

from backsight.analysis.comparison import Row
from backsight.report import _html_tables as tables
from backsight.report._answers import asked
from backsight.report._plots import (
    innovation_plots,
    input_plots,
    nis_plot,
    output_plots,
    status_plots,
)
from backsight.report._series import Plot, Series, signal_units
from backsight.report.figures.bands import state_plots, virtual_plots
from backsight.report.figures.hit_maps import NOTE, force_maps, hit_tables
from backsight.report.figures.spectra import spectrum_plots

MANY = 6
"""Sensors up to which their plots are in one section for each kind; more have a part each."""

_BANDS = "<p>Lines are estimates, bands three standard deviations either way.</p>"
_INNOVATIONS = (
    "<p>Measurement minus its one-step prediction. Of a consistent estimator, 99.7 % lie "
    "between the lines at three standard deviations, without a pattern.</p>"
)
_SPECTRA = (
    "<p>Power of the normalised innovations over the frequency. That of a consistent estimator is "
    "flat, 1 everywhere: a peak is a mode or an order that the model lacks, a rise towards low "
    "frequencies a drift.</p>"
)
_NIS = (
    "<p>Innovations measured with their own covariance. Of a consistent estimator, 95 % "
    "lie in the band; above it the estimator is over-confident, below it too cautious. "
    "They are neither correlated with each other nor explained by inputs.</p>"
)


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the page: a heading, text, plots, and what stands below them.

    Parameters
    ----------
    name, text : str
        Heading, and what stands above the plots (HTML).
    own : list of Plot
        Plots of the section itself.
    below : str
        What stands below them (HTML).
    parts : dict
        Further plots by name, folded away until somebody opens them.
    """

    name: str
    text: str = ""
    own: Sequence[Plot] = ()
    below: str = ""
    parts: Mapping[str, Sequence[Plot]] = dataclasses.field(default_factory=dict)

    @property
    def plots(self) -> list[Plot]:
        """All plots in their order on the page."""
        return [*self.own, *(plot for part in self.parts.values() for plot in part)]

    @property
    def anchor(self) -> str:
        """Where links lead to."""
        return self.name.lower().replace(" ", "-")

    def __str__(self) -> str:
        parts = "".join(
            f'<details class="part"><summary>{escape(name)}</summary>{_grid(plots)}</details>'
            for name, plots in self.parts.items()
        )
        return (
            f'<details open class="section" id="{self.anchor}"><summary><h2>{self.name}</h2>'
            f"</summary>{self.text}{_grid(self.own)}{self.below}{parts}</details>"
        )


def sections(
    rows: Sequence[Row], every: Sequence[Series], reference: Mapping[str, float]
) -> list[Section]:
    """Return pictures first, what was asked for before what moves, and statistics behind."""
    states, outputs = signal_units(every, "state"), signal_units(every, "output")
    maps = force_maps(rows, every)
    first = [name for name in asked(every) if len(asked(every)) < len(states)]
    moving = [name for name in states if name not in first]
    happened = status_plots(every)
    many = len(outputs) > MANY
    measured, innovations = output_plots(every), innovation_plots(every)
    spectra = spectrum_plots(every)
    found = [
        Section("Unknown forces", NOTE if maps else "", maps, hit_tables(rows, every)),
        Section("Where no sensor is", tables.virtual_table(rows, every), virtual_plots(every)),
        Section("Unknowns", _BANDS, state_plots(every, reference, first)),
        Section("States", "" if first else _BANDS, state_plots(every, reference, moving)),
        Section("Measured and estimated", "", [] if many else measured),
        Section("Inputs", "", input_plots(every)),
        Section("Values", tables.final_values_table(rows, every, states)),
        Section("Innovations", _INNOVATIONS, [] if many else innovations),
        Section("Consistency", _NIS + tables.consistency_table(rows, every), [nis_plot(every)]),
        Section("Spectra", _SPECTRA, [] if many else spectra),
        Section(
            "Sensors",
            f"<p>Each of {len(outputs)} with its measurements, innovations and their spectrum.</p>",
            parts=_by_sensor(outputs, [*measured, *innovations, *spectra]) if many else {},
        ),
        Section("Comparison", tables.comparison(rows, every, outputs)),
        Section("Status", tables.status_list(rows) if happened else "", happened),
    ]
    only_with_plots = (_BANDS, _INNOVATIONS, _SPECTRA)
    return [
        s
        for s in found
        if s.plots or s.below or (s.text and s.text not in only_with_plots and s.name != "Sensors")
    ]


def contents(every: Sequence[Section]) -> str:
    """Links to all sections."""
    return "".join(f'<a href="#{s.anchor}">{s.name}</a>' for s in every)


def _by_sensor(outputs: Mapping[str, str], plots: Sequence[Plot]) -> dict[str, list[Plot]]:
    """Plots that are about the same output."""
    return {name: [plot for plot in plots if plot.about == name] for name in outputs}


def _grid(plots: Sequence[Plot]) -> str:
    return f'<div class="plots">{"".join(map(_place, plots))}</div>' if plots else ""


def _place(plot: Plot) -> str:
    kind = "wide" if plot.wide else "first" if plot.first else ""
    label, style = escape(plot.label), f"height: {plot.height}px"
    return (
        f'<div class="plot {kind}"><figure role="group" aria-label="{label}" style="{style}">'
        "</figure></div>"
    )
