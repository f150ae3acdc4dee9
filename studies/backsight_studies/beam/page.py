"""The page of the study."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.rounding import significant
from backsight_studies import html
from backsight_studies.beam import expected, remarks
from backsight_studies.beam.experiment import SWEPT, Experiment
from backsight_studies.beam.plant import THICKNESS
from backsight_studies.beam.tuning import CARRYOVERS, READING_3, SETTINGS, TABLE, THRESHOLD
from backsight_studies.check_tables import expected_table
from backsight_studies.checks import Check
from backsight_studies.claims import Claim, numbers, tally
from backsight_studies.html import Cell

TITLE = "A struck beam: compressive-sensing moving horizon estimation of unknown forces"


def build(
    e: Experiment, claims: Sequence[Claim], checks: Sequence[Check], figures: Mapping[str, Path]
) -> str:
    """The whole page as HTML."""
    pictures = "".join(
        html.picture(figures[name], caption) for name, caption in remarks.CAPTIONS.items()
    )
    sections = [
        ("The experiment", html.text(*remarks.SETUP)),
        ("How the paper was read", html.items(*remarks.READINGS)),
        ("What was found", html.text(remarks.CASES) + "".join(_cases(e, s) for s in SETTINGS)),
        ("What the covariance scales, and what sparsity is good for", _covariance(e)),
        ("Which statements hold", html.text(remarks.CLAIMS) + claims_table(claims)),
        ("Figures", pictures),
        ("Checks", expected_table(numbers(checks))),
    ]
    lead = html.text(remarks.LEAD) + html.items(*short(e, claims, checks))
    return html.page(TITLE, sections, lead=lead, foot=html.text(remarks.SOURCE, remarks.LIMITS))


def short(e: Experiment, claims: Sequence[Claim], checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences, for the page and the terminal."""
    third = {m: e.cases["one setting", READING_3, m].score for m in THICKNESS}
    all_four = sum(min(map(abs, c.score.recovered)) >= THRESHOLD for c in e.cases.values())
    errors = ", ".join(f"{100 * s.relative:.1f} % at {m:g} %" for m, s in third.items())
    return [
        tally(numbers(checks)),
        f"{sum(c.holds for c in claims)} of {len(claims)} statements of the paper hold.",
        f"All four hits are found at the right place and time in {all_four} of {len(e.cases)} "
        "cases (two settings, four readings, four mismatches). With reading III and one "
        f"setting for all, the relative error of the output is {errors}.",
    ]


def claims_table(claims: Sequence[Claim]) -> str:
    """Every statement, whether it holds, and the numbers that decide."""
    return html.table(
        ["statement", "holds"],
        [
            [
                Cell(c.text, f"{c.setting}: {c.measured}"),
                Cell("yes" if c.holds else "no", good=c.holds),
            ]
            for c in claims
        ],
    )


def _cases(e: Experiment, setting: str) -> str:
    head = ["reading", *(f"{m:g} %" for m in THICKNESS)]
    rows: list[list[str | Cell]] = []
    for reading in CARRYOVERS:
        cells: list[str | Cell] = [reading]
        for m in THICKNESS:
            s = e.cases[setting, reading, m].score
            hits = " / ".join(f"{v:.2f}" for v in s.recovered)
            cells.append(
                Cell(
                    f"{significant(s.mse, 3)} | {100 * s.relative:.1f} % | {s.false} "
                    f"({s.false_large})",
                    hits,
                )
            )
        rows.append(cells)
    caption = (
        f"{setting}: MSE [N²] | relative error of the output | false forces of 1 N (2 N) or more; "
        "below, the four hits [N], truly −10 / −5 / 5 / 10"
    )
    return html.table(head, rows, caption=caption)


def _covariance(e: Experiment) -> str:
    head = ["", *(f"{m:g} %" for m in THICKNESS)]
    rows = [
        ["λ of Table 3 [1/N]", *(f"{TABLE[m].lam:.2e}" for m in THICKNESS)],
        ["nothing found from, Q = ε_Q I", *(f"{e.identity[m]:.1e}" for m in THICKNESS)],
        ["nothing found from, Q = ε_Q B B'", *(f"{e.through_B[m]:.2g}" for m in THICKNESS)],
        ["MSE with squares [N²]", *(f"{e.ridge[m]:.3f}" for m in THICKNESS)],
    ]
    return html.text(remarks.COVARIANCE) + html.table(head, rows) + _filters(e)


def _filters(e: Experiment) -> str:
    head = ["forces looked for", "filter", *(f"{m:g} %" for m in SWEPT)]
    rows = [
        [places, kind, *(f"{found[places, m]:.3g}" for m in SWEPT)]
        for kind, found in (("random walks", e.walks), ("joint input and state", e.joint))
        for places in dict.fromkeys(name for name, _ in found)
    ]
    caption = f"MSE of the output [N²]; that of no force at all is {expected.ZERO_MSE}"
    return html.text(remarks.FILTERS) + html.table(head, rows, caption=caption)
