"""The numbers of the study as CSV files."""

from collections.abc import Sequence
from pathlib import Path

from backsight_studies.claims import Claim, write_claims
from backsight_studies.punch.evaluate import PARAMETERS
from backsight_studies.punch.experiment import Experiment
from backsight_studies.sheets import write_sheet


def write_tables(experiment: Experiment, claims: Sequence[Claim], out: Path) -> None:
    """Write ``starts``, ``jumps``, ``gains``, ``biases`` and ``claims.csv``."""
    write_sheet(out / "starts.csv", *_starts(experiment))
    write_sheet(out / "jumps.csv", *_jumps(experiment))
    write_sheet(out / "gains.csv", *_gains(experiment))
    write_sheet(
        out / "biases.csv",
        ["qx", "sigma_y", "bias_d"],
        [[b.speed_noise, b.sensor_noise, b.bias] for b in experiment.biases],
    )
    write_claims(claims, out)


def _starts(experiment: Experiment) -> tuple[list[str], list[list[object]]]:
    fields = ("time", "error", "bias", "std")
    head = ["scenario", "seed", "observer", *_columns(fields), "us_per_sample"]
    rows: list[list[object]] = [
        [
            r.scenario.label,
            r.seed,
            r.label,
            *(getattr(r.measures, f)[p] for f in fields for p in PARAMETERS),
            r.measures.us_per_sample,
        ]
        for r in experiment.rows
    ]
    return head, rows


def _jumps(experiment: Experiment) -> tuple[list[str], list[list[object]]]:
    fields = ("time", "excursion", "error")
    head = ["reading", "observer", "jump_of", *_columns(fields)]
    rows: list[list[object]] = [
        [
            r.reading.name,
            r.label,
            r.jumped,
            *(getattr(r.response, f)[p] for f in fields for p in PARAMETERS),
        ]
        for r in experiment.jumps
    ]
    return head, rows


def _gains(experiment: Experiment) -> tuple[list[str], list[list[object]]]:
    head = ["reading", "seed", "gain", *_columns(("std",)), "time_c", "lambda_before", "rise"]
    rows: list[list[object]] = [
        [
            r.reading.name,
            r.seed,
            r.label,
            *(r.gain.std[p] for p in PARAMETERS),
            r.gain.time,
            r.gain.before,
            r.gain.rise,
            r.gain.us_per_sample,
        ]
        for r in experiment.gains
    ]
    return [*head, "us_per_sample"], rows


def _columns(fields: Sequence[str]) -> list[str]:
    return [f"{f}_{p}" for f in fields for p in PARAMETERS]
