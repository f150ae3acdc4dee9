"""Numbers of a study as CSV files."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from backsight.output import write_whole


def write_sheet(path: Path, head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table; numbers with ten digits."""
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow([f"{v:.10g}" if isinstance(v, float) else v for v in row])
    write_whole(path, lines.getvalue().encode())
