"""The numbers of the study as CSV files."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from backsight_studies.nanopositioner.claims import Verdict
from backsight_studies.nanopositioner.evaluate import Measures, speed_floor
from backsight_studies.nanopositioner.expected import TABLE_I
from backsight_studies.nanopositioner.experiment import Experiment, compared
from backsight_studies.nanopositioner.spread import ratio, spread
from backsight_studies.sheets import write_sheet

FIELDS = tuple(f.name for f in dataclasses.fields(Measures))

RATIOS = ("rse_x1", "rse_x2", "rse_x1_settled", "rse_x2_settled")
"""Measures that are also given per that of the EKF."""


def write_tables(experiment: Experiment, verdicts: Sequence[Verdict], out: Path) -> None:
    """Write ``measures.csv`` (every run), ``table1.csv`` (means and ranges) and ``claims.csv``."""
    write_sheet(out / "measures.csv", *_measures(experiment))
    write_sheet(out / "table1.csv", *_table_one(experiment))
    rows = [
        [v.claim.text, v.scenario, v.solver, v.holds, v.of, v.passed, v.numbers] for v in verdicts
    ]
    head = ["claim", "scenario", "solver", "holds", "of", "passed", "means"]
    write_sheet(out / "claims.csv", head, rows)


def _measures(experiment: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["recording", "scenario", "seed", "method", "solver", "alpha", *FIELDS]
    head += ["rse_x2_settled_of_true_speed"]
    rows = [
        [
            r.trial.label,
            r.trial.scenario,
            "" if r.trial.seed is None else r.trial.seed,
            r.variant.method,
            r.variant.solver,
            getattr(r.variant.estimator, "alpha", ""),
            *dataclasses.astuple(r.measures),
            speed_floor(r.trial.stage),
        ]
        for r in experiment.rows
    ]
    return head, rows


def _table_one(experiment: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["scenario", "method", "solver", "recordings", "paper_rse_x1", "paper_rse_x2"]
    for field in (*FIELDS, *(f"{f}_per_ekf" for f in RATIOS)):
        head += [field, f"{field}_min", f"{field}_max"]
    rows: list[list[object]] = []
    for scenario in experiment.scenarios:
        for variant in compared():
            row: list[object] = [scenario, variant.method, variant.solver]
            row += [len(experiment.trials(scenario)), *TABLE_I[variant.method]]
            for field in FIELDS:
                row += dataclasses.astuple(spread(experiment, scenario, variant.label, field))
            for field in RATIOS:
                row += dataclasses.astuple(ratio(experiment, scenario, variant.label, field))
            rows.append(row)
    return head, rows
