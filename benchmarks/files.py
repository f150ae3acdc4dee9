"""Results as files: tables with commas, and the figures to reach."""

import csv
import dataclasses
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from backsight.output import write_whole
from benchmarks.accuracy import Accuracy
from benchmarks.bars import Bar, Measured
from benchmarks.efficiency import Efficiency


def write(
    folder: Path,
    *,
    machine: Mapping[str, str],
    measured: Measured,
    efficiencies: Sequence[Efficiency],
    accuracies: Sequence[Accuracy],
    bars: Sequence[Bar],
) -> None:
    """Write everything into a folder."""
    table(folder / "machine.csv", [{"name": k, "value": v} for k, v in machine.items()])
    for name, records in {
        "times": measured.rows,
        "startup": measured.startups,
        "scaling": measured.points,
        "efficiency": efficiencies,
    }.items():
        table(folder / f"{name}.csv", [dataclasses.asdict(record) for record in records])
    table(folder / "accuracy.csv", [accuracy.record() for accuracy in accuracies])
    text = json.dumps([dataclasses.asdict(bar) for bar in bars], indent=2) + "\n"
    write_whole(folder / "bars.json", text.encode())


def table(path: Path, records: Sequence[Mapping[str, Any]]) -> None:
    """Write records of the same fields; numbers with 5 digits, what is missing as nothing."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(records[0]), lineterminator="\n")
    writer.writeheader()
    for record in records:
        writer.writerow({name: _short(value) for name, value in record.items()})
    write_whole(path, text.getvalue().encode())


def _short(value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return "" if value != value else f"{value:.5g}"
