"""The numbers of the study as CSV files."""

from pathlib import Path

from backsight_studies.arrival.evaluate import right
from backsight_studies.arrival.experiment import Experiment
from backsight_studies.arrival.plants import REACTOR, SPRING
from backsight_studies.sheets import write_sheet


def write_tables(experiment: Experiment, out: Path) -> None:
    """Write ``runs``, ``summary`` and, if there are measured machines, ``machines.csv``."""
    write_sheet(out / "runs.csv", *_runs(experiment))
    write_sheet(out / "summary.csv", *_summary(experiment))
    if experiment.machines:
        write_sheet(out / "machines.csv", *_machines(experiment))


def listed(experiment: Experiment, plant: str) -> list[tuple[str, int]]:
    """Estimators that ran on a plant: label and horizon."""
    return list(dict.fromkeys((r.label, r.N) for r in experiment.rows if r.plant == plant))


def _runs(e: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["plant", "estimator", "N", "seed", "error", "last", "covered", "lost", "open"]
    rows: list[list[object]] = []
    for r in e.rows:
        m = r.measures
        covered = sum(m.covered.values()) / len(m.covered)
        row: list[object] = [
            r.plant,
            r.label,
            r.N,
            r.seed,
            m.error,
            m.last,
            covered,
            m.lost,
            m.open_,
        ]
        row += [right(m) if r.plant == REACTOR else "", r.distance if r.plant == SPRING else ""]
        rows.append(row)
    return [*head, "right", "distance"], rows


def _summary(e: Experiment) -> tuple[list[str], list[list[object]]]:
    rows: list[list[object]] = [
        [
            plant.name,
            label,
            N,
            plant.judged,
            plant.unit,
            e.error(plant.name, label, N),
            e.covered(plant.name, label, N),
            sum(m.lost for m in e.of(plant.name, label, N)),
        ]
        for plant in e.plants
        for label, N in listed(e, plant.name)
    ]
    return ["plant", "estimator", "N", "state", "unit", "error", "covered", "lost"], rows


def _machines(e: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["machine", "start", "estimator", "parameter", "time", "error", "deviations"]
    rows: list[list[object]] = [
        [c.machine, c.start, c.label, p, c.time[p], c.error[p], c.deviations[p], c.us_per_sample]
        for c in e.machines
        for p in c.time
    ]
    return [*head, "us_per_sample"], rows
