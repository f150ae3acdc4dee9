"""The numbers of the study as a CSV file."""

from pathlib import Path

from backsight_studies.beam_random.experiment import Experiment
from backsight_studies.beam_random.page import FIELDS
from backsight_studies.sheets import write_sheet


def write_tables(e: Experiment, out: Path) -> None:
    """Write ``methods.csv``: the means of every method."""
    rows: list[list[object]] = [
        [method, m, *(e.mean(method, m, field) for field in FIELDS)] for method, m in e.outcomes
    ]
    write_sheet(out / "methods.csv", ["method", "mismatch_percent", *FIELDS], rows)
