"""The page of the study: every sentence with a number gets it from the experiment."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.rounding import significant
from backsight_studies import html
from backsight_studies.check_tables import expected_table
from backsight_studies.checks import Check
from backsight_studies.claims import Claim, numbers, tally
from backsight_studies.html import Cell
from backsight_studies.punch import remarks
from backsight_studies.punch.claims import percent, seconds
from backsight_studies.punch.evaluate import PARAMETERS, Measures
from backsight_studies.punch.experiment import Experiment, median
from backsight_studies.punch.plant import READINGS
from backsight_studies.punch.scenarios import ADAPTIVE, FIXED, JUMPS, ONLY_D, STARTS, Scenario

TITLE = "Punch: adaptive high-gain observer against extended and unscented Kalman filter"


def build(
    experiment: Experiment,
    claims: Sequence[Claim],
    checks: Sequence[Check],
    figures: Mapping[str, Path],
) -> str:
    """The whole page as HTML."""
    starts = "".join(_starts(experiment, s) for s in STARTS)
    only_d = "".join(_starts(experiment, s) for s in ONLY_D)
    pictures = "".join(html.picture(figures[name], c) for name, c in remarks.CAPTIONS.items())
    bias = html.text(remarks.BIAS) + html.picture(figures["bias"], remarks.BIAS_CAPTION)
    sections = [
        ("The experiment", html.text(*remarks.SETUP)),
        ("Soft or stiff", html.text(remarks.EXCITATION) + _excitation(experiment)),
        ("Which statements hold", html.text(remarks.CLAIMS) + _claims(claims)),
        ("Convergence from a wrong start", html.text(remarks.TIMES) + starts),
        ("Form of the observer, and the measurement between samples", html.text(*remarks.FORM)),
        ("What the start leaves right", html.text(remarks.START) + only_d),
        ("Why the filters miss the damping", bias),
        ("Jumps of the parameters", html.text(remarks.JUMPS) + _jumps(experiment)),
        ("Fixed and adaptive gain", html.text(remarks.GAINS) + _gains(experiment)),
        ("Figures", pictures),
        ("How ambiguities and misprints were read", html.items(*remarks.READINGS)),
        ("Checks", expected_table(numbers(checks))),
    ]
    lead = html.text(remarks.LEAD) + html.items(*short(claims, checks))
    return html.page(TITLE, sections, lead=lead, foot=html.text(remarks.SOURCE, remarks.LIMITS))


def short(claims: Sequence[Claim], checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences, for the page and the terminal."""
    points = [
        tally(numbers(checks)),
        f"{sum(c.holds for c in claims)} of {len(claims)} statements of the paper hold.",
    ]
    for claim in claims:
        if claim.text.startswith(("The AHG converges", "EKF and UKF miss")):
            verdict = "holds" if claim.holds else "does not hold"
            points.append(f"“{claim.text}” ({claim.setting}) {verdict}: {claim.measured}.")
    return points


def _excitation(e: Experiment) -> str:
    names = list(next(iter(e.excitation.values())))
    rows = [[r, *(significant(v[n], 3) for n in names)] for r, v in e.excitation.items()]
    return html.table(["reading", *names], rows)


def _claims(claims: Sequence[Claim]) -> str:
    rows: list[list[str | Cell]] = [
        [Cell(c.text, c.setting), Cell("yes" if c.holds else "no", c.measured, good=c.holds)]
        for c in claims
    ]
    return html.table(["statement", "holds"], rows)


def _starts(e: Experiment, scenario: Scenario) -> str:
    labels = dict.fromkeys(r.label for r in e.rows if r.scenario == scenario)
    head = ["observer"]
    head += [f"{p} within 5 % after" for p in PARAMETERS]
    head += [f"{what} of {p} [%]" for what in ("bias", "noise") for p in PARAMETERS]
    rows: list[list[str | Cell]] = []
    for label in labels:
        found = e.of(scenario, label)
        times = [_time([m.time[p] for m in found]) for p in PARAMETERS]
        rows.append([label, *times, *_errors(found)])
    return html.table(head, rows, caption=scenario.label)


def _time(values: Sequence[float]) -> Cell:
    arrived = sum(math.isfinite(v) for v in values)
    note = f"{arrived} of {len(values)}" if len(values) > 1 else ""
    return Cell(seconds(median(values)), note)


def _errors(found: Sequence[Measures]) -> list[str]:
    return [
        _share(median([getattr(m, field)[p] for m in found]))
        for field in ("bias", "std")
        for p in PARAMETERS
    ]


def _share(value: float) -> str:
    return significant(100 * value, 2) if math.isfinite(value) else "–"


def _jumps(e: Experiment) -> str:
    head = ["observer", *(f"{p} within 5 % after its jump" for p in JUMPS)]
    parts = []
    for reading in READINGS:
        labels = dict.fromkeys(r.label for r in e.jumps if r.reading == reading)
        rows: list[list[str | Cell]] = []
        for label in labels:
            cells = []
            for p in JUMPS:
                response = e.jump(reading, label, p)
                others = [f"{q} {percent(v)}" for q, v in response.excursion.items() if q != p]
                cells.append(Cell(seconds(response.time[p]), "others: " + ", ".join(others)))
            rows.append([label, *cells])
        parts.append(html.table(head, rows, caption=f"{reading.name} spring"))
    return "".join(parts)


def _gains(e: Experiment) -> str:
    head = ["gain", *(f"noise of {p} [%]" for p in PARAMETERS), "response of c", "λ before [1/s]"]
    parts = []
    for reading in READINGS:
        rows: list[list[str | Cell]] = []
        for label in (FIXED, ADAPTIVE):
            found = e.gain(reading, label)
            noise = [_share(median([g.std[p] for g in found])) for p in PARAMETERS]
            time = _time([g.time for g in found])
            rows.append([label, *noise, time, significant(median([g.before for g in found]), 4)])
        parts.append(html.table(head, rows, caption=f"{reading.name} spring, medians"))
    return "".join(parts)
