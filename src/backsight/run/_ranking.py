"""The comparison of results as tables for a terminal."""

import io
import math
from collections.abc import Mapping, Sequence

from rich import box
from rich.console import Console
from rich.table import Table

from backsight.analysis.comparison import Final, Row, VirtualOutput
from backsight.rounding import grouped, percent, plus_minus, shortest, significant
from backsight.schema import Status

MOST_HITS = 20
"""Hits of a table."""

SHOWN = ("time", "place", "speed", "size")
"""What a table tells of hits, as far as it is known."""

MOST_OUTPUTS = 2
"""Of more outputs the innovations are not shown: a line has 80 columns."""


def ranking(rows: Sequence[Row], outputs: Mapping[str, str]) -> Table:
    """One line per estimator, best first.

    Parameters
    ----------
    rows : sequence of Row
        As `backsight.analysis.comparison._summary.ranked_table` gives them.
    outputs : dict
        Name to unit.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("", "estimator"):
        table.add_column(heading, no_wrap=True)
    shown = outputs if len(outputs) <= MOST_OUTPUTS else {}
    numbers = [
        "log-lik.\nper sample",
        f"mean NIS\n(ideal: {shortest(rows[0].nis_expected)})",
        *(f"RMS innov.\n{_labelled(name, unit)}" for name, unit in shown.items()),
        "µs per\nsample",
    ]
    for heading in numbers:
        table.add_column(heading, justify="right")
    table.add_column("status")
    for rank, row in enumerate(rows, 1):
        table.add_row(
            str(rank),
            row.estimator,
            significant(row.log_likelihood, 5),
            significant(row.mean_nis, 3),
            *(significant(row.rms_innovation.get(name, math.nan), 3) for name in shown),
            significant(row.us_per_sample, 3),
            _status(row),
        )
    return table


def final_values(rows: Sequence[Row]) -> Table:
    """Last estimate of every state with its standard deviation, one column per estimator."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    finals = {name: final for row in reversed(rows) for name, final in row.final.items()}
    references = any(final.reference is not None for final in finals.values())
    table.add_column("at the end", no_wrap=True)
    for row in rows:
        table.add_column(row.estimator, justify="right")
    if references:
        table.add_column("reference", justify="right")
    for name, final in finals.items():
        cells = [_final(row.final.get(name)) for row in rows]
        if references:
            cells.append("" if final.reference is None else shortest(final.reference))
        table.add_row(_labelled(name, final.unit), *cells)
    return table


def true_errors(rows: Sequence[Row]) -> Table:
    """Root mean square error of every state whose truth is known, one column per estimator."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("RMS error", no_wrap=True)
    for row in rows:
        table.add_column(row.estimator, justify="right")
    known = {name: row.final[name].unit for row in reversed(rows) for name in row.rms_error}
    for name, unit in known.items():
        errors = [row.rms_error.get(name, math.nan) for row in rows]
        if not all(map(math.isnan, errors)):
            table.add_row(_labelled(name, unit), *(significant(e, 3) for e in errors))
    return table


def virtual_values(rows: Sequence[Row]) -> Table:
    """Size of every virtual output with its typical deviation, one column per estimator.

    Where the truth is known, its root mean square error stands behind.
    """
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("virtual (RMS)", no_wrap=True)
    for row in rows:
        table.add_column(row.estimator, justify="right")
    every = {name: found for row in reversed(rows) for name, found in row.virtual.items()}
    for name, found in every.items():
        cells = [_virtual(row.virtual.get(name)) for row in rows]
        table.add_row(_labelled(name, found.unit), *cells)
    return table


def hits_table(row: Row, shown: int = MOST_HITS) -> Table:
    """Hits of an estimator that were fitted as pulses, in the order of time."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    first, count = row.fitted_hits[0], len(row.fitted_hits)
    title = f"{row.estimator}: {count} hit{'s' * (count > 1)}"
    table.add_column(title if count <= shown else f"{title}, the first {shown}", no_wrap=True)
    for name in SHOWN:
        if name in first.numbers:
            heading = _labelled(name, first.numbers[name].unit)
            table.add_column(heading, justify="right", no_wrap=True)
    for i, hit in enumerate(row.fitted_hits[:shown], 1):
        numbers = [hit.numbers[name] for name in SHOWN if name in hit.numbers]
        cells = [plus_minus(n.value, n.std) if n.std > 0 else shortest(n.value) for n in numbers]
        table.add_row(hit.force or str(i), *cells)
    return table


def _virtual(found: VirtualOutput | None) -> str:
    if found is None:
        return ""
    text = plus_minus(found.rms, found.typical_std)
    return text if not found.within else f"{text} (error {significant(found.rms_error, 2)})"


def as_text(tables: Sequence[Table], width: int) -> str:
    """Return tables as plain text, at most `width` columns wide."""
    page = Console(file=io.StringIO(), width=width, color_system=None, legacy_windows=False)
    with page.capture() as written:
        page.print(*tables, sep="")
    return "\n".join(line.rstrip() for line in written.get().strip("\n").splitlines())


def _labelled(name: str, unit: str) -> str:
    # rich takes what stands in square brackets for its markup
    return f"{name} \\[{unit}]" if unit else name


def _final(final: Final | None) -> str:
    if final is None:
        return ""
    text = final.shown
    if final.reference is None or math.isnan(final.value):
        return text
    error = percent(final.relative_error) if final.reference else significant(final.error, 2)
    return f"{text} ({error})"


def _status(row: Row) -> str:
    if row.failed:
        return "diverged"
    found = [bit for bit in Status if bit and bit.name in row.status]
    lines = [f"{_words(bit)} {grouped(row.status[str(bit.name)])}×" for bit in found]
    return "\n".join(lines) or "ok"


def _words(bit: Status) -> str:
    return str(bit.name).replace("_", " ").lower()
