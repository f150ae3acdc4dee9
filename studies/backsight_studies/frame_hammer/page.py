"""The page of the study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight_studies import html
from backsight_studies.check_tables import required_table
from backsight_studies.checks import Check
from backsight_studies.frame_hammer.experiment import Case, Experiment
from backsight_studies.frame_hammer.remarks import in_short, remarks
from backsight_studies.frame_hammer.source import SOURCE
from backsight_studies.html import Cell

TITLE = "Where, when and how hard a beam was hit, from four accelerometers"

CAPTIONS = {
    "hits": "Above, the reading of the uppermost sensor: hits can hardly be seen in the ringing "
    "of those before. Below, the hits that were found and those of the hammer's own sensor.",
    "heights": "How well a hit at each height explains the window around it. The wrong heights "
    "explain less, whatever time, size and pulse they are given.",
    "window": "A window with a hit: left, readings and model; right, the accelerations that were "
    "found. What is beyond the limit of the sensor is never seen.",
    "forces": "Forces that the compressive-sensing MHE finds in the straightened signals.",
    "sizes": "Size of the hits: measured and simulated. In the strong direction the hammer's own "
    "sensor was at its limit.",
}


def build(experiment: Experiment, checks: Sequence[Check], figures: Mapping[str, Path]) -> str:
    """The whole page as HTML."""
    sections = [("What works and what does not", html.items(*remarks(experiment)))]
    sections.append(("Recordings", _recordings(experiment)))
    for case in experiment.measured:
        pictures = "".join(
            html.picture(figures[key], caption)
            for kind, caption in CAPTIONS.items()
            if (key := f"{kind}_{case.recording.name}") in figures
        )
        sections.append((case.recording.name, pictures))
    caption = CAPTIONS["sizes"]
    sections.append(("Sizes", html.picture(figures["sizes"], caption)))
    sections.append(("Checks", required_table(checks)))
    lead = html.items(*short(experiment, checks))
    return html.page(TITLE, sections, lead=lead, foot=html.text(f"Recordings: {SOURCE}."))


def short(experiment: Experiment, checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences."""
    lines = [f"{sum(c.passed for c in checks)} of {len(checks)} checks are met."]
    lines += [
        in_short(c.recording.name, c.score) for c in experiment.measured if c.score is not None
    ]
    scores = [c.score for c in experiment.simulated if c.score is not None]
    if scores:
        lines.append(
            f"simulated, at all heights: {sum(s.right for s in scores)} of "
            f"{sum(s.isolated for s in scores)} isolated hits at the right height, "
            f"{sum(s.false for s in scores)} false alarms."
        )
    return lines


def _recordings(experiment: Experiment) -> str:
    head = [
        "recording", "direction", "hits found", "isolated", "right height", "false",
        "largest error of time [ms]", "smallest margin", "unexplained [%]",
    ]  # fmt: skip
    cases = (*experiment.measured, *experiment.simulated)
    caption = (
        "Margin: unexplained energy with the second best height over that with the best; "
        "unexplained: share of the energy of windows without a hit."
    )
    return html.table(head, [_row(case) for case in cases], caption=caption)


def _row(case: Case) -> list[str | Cell]:
    d, s = case.detection, case.score
    margin = min((hit.margin for hit in d.hits), default=float("nan"))
    known: list[str | Cell] = (
        ["-"] * 4
        if s is None
        else [
            str(s.isolated),
            Cell(str(s.right), good=s.right >= 0.9 * s.isolated),
            Cell(str(s.false), good=s.false <= 0.1 * s.reported),
            f"{1e3 * s.latest:.2f}",
        ]
    )
    return [
        case.recording.name, d.start.name, str(len(d.hits)), *known, f"{margin:.1f}",
        f"{100 * case.limited:.2f}",
    ]  # fmt: skip
