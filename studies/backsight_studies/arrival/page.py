"""The page of the study: every sentence with a number gets it from the experiment."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.rounding import significant
from backsight_studies import html
from backsight_studies.arrival import remarks
from backsight_studies.arrival.expected import nonlinear
from backsight_studies.arrival.experiment import SHOWN, Experiment
from backsight_studies.arrival.machines import Convergence
from backsight_studies.arrival.methods import CLIPPED, KALMAN, LINEAR, NAIVE, NONE, SMOOTHED, SOUND
from backsight_studies.arrival.plants import HORIZONS, REACTOR, SPRING, Plant
from backsight_studies.arrival.tables import listed
from backsight_studies.check_tables import expected_table
from backsight_studies.checks import Check
from backsight_studies.html import Cell

TITLE = "Arrival costs of moving horizon estimation, compared"


def build(experiment: Experiment, checks: Sequence[Check], figures: Mapping[str, Path]) -> str:
    """The whole page as HTML."""
    e = experiment
    spring, reactor, *others = e.plants
    pictures = {name: html.picture(figures[name], text) for name, text in remarks.CAPTIONS.items()}
    sections = [
        ("What is compared", html.text(*remarks.SETUP)),
        ("A linear plant: equal to the Kalman filter or not", _spring(e, spring)),
        (
            "Batch reactor: two optima",
            html.text(*remarks.REACTOR) + pictures["reactor"] + _table(e, reactor),
        ),
        (
            "Oscillators with unknown parameters",
            html.text(remarks.OTHERS) + "".join(_table(e, plant) for plant in others),
        ),
        ("Error and bands over the horizon", pictures["horizon"] + pictures["bands"]),
        ("Measured machines", _machines(e, figures)),
        ("Checks", expected_table(checks)),
    ]
    lead = html.text(remarks.LEAD) + html.items(*short(e, checks))
    return html.page(TITLE, sections, lead=lead, foot=html.text(remarks.SOURCE, remarks.LIMITS))


def short(e: Experiment, checks: Sequence[Check]) -> list[str]:
    """The study in a few sentences, for the page and the terminal."""
    failed = [c.name for c in checks if not c.passed]
    total = len(e.seeds)
    same = max(e.distance(label, N) for label in SOUND for N in HORIZONS)
    shortest = HORIZONS[0]
    points = [
        f"{len(checks) - len(failed)} of {len(checks)} checks are met"
        + (f"; not: {'; '.join(failed)}." if failed else "."),
        f"Linear plant: the arrival costs {', '.join(SOUND)} equal the Kalman filter to "
        f"{same:.1g} standard deviations; with {NONE} the estimate is off by up to "
        f"{significant(e.distance(NONE, shortest), 2)}, with {NAIVE} by "
        f"{significant(e.distance(NAIVE, shortest), 2)} (N = {shortest}).",
        f"Batch reactor: MHE ({SMOOTHED}, N = {SHOWN}) finds the right optimum in "
        f"{e.found(SMOOTHED, SHOWN)} of {total} recordings, the EKF in {e.found(KALMAN, 0)}, "
        f"clipped to the bounds in {e.found(CLIPPED, 0)}, MHE without arrival cost in "
        f"{e.found(NONE, SHOWN)}.",
        *(_gain(e, plant) for plant in e.plants if plant.name not in (SPRING, REACTOR)),
        "Two deviations hold the truth in "
        + ", ".join(
            f"{_percent(e.covered(p, SMOOTHED, SHOWN))} ({p}; {NAIVE}: "
            f"{_percent(e.covered(p, NAIVE, SHOWN))})"
            for p in nonlinear(e)
        )
        + f" of the samples with the arrival cost {SMOOTHED}.",
    ]
    return [*points, *(_start(c) for c in e.machines)]


def _gain(e: Experiment, plant: Plant) -> str:
    window, alone = e.error(plant.name, SMOOTHED, SHOWN), e.error(plant.name, KALMAN, 0)
    verdict = "less than" if window < 0.95 * alone else "more than" if window > 1.05 * alone else ""
    compared = f"{verdict} the" if verdict else "as much as the"
    return (
        f"{plant.name}: with the window the error of {plant.judged} is "
        f"{significant(window, 3)} {plant.unit}, {compared} {significant(alone, 3)} of the EKF "
        "alone."
    )


def _start(c: Convergence) -> str:
    when = f"after {significant(c.all_after, 3)} s" if math.isfinite(c.all_after) else "never"
    return (
        f"{c.machine}, all parameters {c.start:g} times their values: {c.label} converges {when}."
    )


def _spring(e: Experiment, plant: Plant) -> str:
    rows: list[list[str | Cell]] = []
    for label, N in listed(e, plant.name):
        if label == LINEAR:
            continue
        far = e.distance(label, N)
        error = e.error(plant.name, label, N) / e.error(plant.name, LINEAR, 0)
        rows.append([label, str(N), f"{far:.1e}" if far < 1e-3 else significant(far, 2),
                     significant(error, 4)])  # fmt: skip
    head = ["arrival cost", "N", "distance from the Kalman filter", "error of the speed per its"]
    return html.text(remarks.SPRING) + html.table(head, rows)


def _table(e: Experiment, plant: Plant) -> str:
    head = ["estimator", "N", f"error of {plant.judged} [{plant.unit or '1'}]", "truth in band"]
    head += ["lost", *(["right optimum"] if plant.name == REACTOR else [])]
    rows: list[list[str | Cell]] = []
    for label, N in listed(e, plant.name):
        measures = e.of(plant.name, label, N)
        error = e.error(plant.name, label, N)
        row: list[str | Cell] = [
            label if N == 0 else f"MHE: {label}",
            str(N) if N else "–",
            significant(error, 3) if math.isfinite(error) else "∞",
            _percent(e.covered(plant.name, label, N)),
            f"{sum(m.lost for m in measures)} of {len(measures)}",
        ]
        if plant.name == REACTOR:
            row.append(f"{e.found(label, N)} of {len(measures)}")
        rows.append(row)
    return html.table(head, rows, caption=plant.name)


def _machines(e: Experiment, figures: Mapping[str, Path]) -> str:
    if not e.machines:
        return html.text(remarks.MISSING)
    parts = [html.text(remarks.MACHINES)]
    for machine in dict.fromkeys(c.machine for c in e.machines):
        found = [c for c in e.machines if c.machine == machine]
        head = ["estimator", "start", *(f"{p} converged after" for p in found[0].time)]
        rows: list[list[str | Cell]] = [
            [c.label, f"{c.start:g}", *(_time(c, p) for p in c.time)] for c in found
        ]
        parts.append(html.table(head, rows, caption=machine))
        caption = remarks.START_CAPTION.format(machine)
        parts.append(html.picture(figures[f"start_{machine.lower()}"], caption))
    return "".join(parts)


def _time(c: Convergence, p: str) -> Cell:
    after = f"{significant(c.time[p], 3)} s" if math.isfinite(c.time[p]) else "never"
    note = f"in the end {significant(100 * c.error[p], 2)} %, {significant(c.deviations[p], 2)} σ"
    return Cell(after, note)


def _percent(share: float) -> str:
    return f"{significant(100 * share, 3)} %"
