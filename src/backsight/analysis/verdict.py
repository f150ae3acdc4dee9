"""What the comparison table means, in words."""

import math
from collections.abc import Sequence

from backsight.analysis.rounding import significant
from backsight.analysis.summary import Row

_CLOSE = 0.10
"""Innovations that are so much larger or smaller than predicted do no harm in practice."""


def verdicts(rows: Sequence[Row]) -> list[str]:
    """Return a few lines: the ranking, then consistency and final errors of each estimator.

    Parameters
    ----------
    rows : sequence of Row
        As `ranked_table` gives them, best first.
    """
    ranking = [_ranking(rows)] if len(rows) > 1 else []
    return ranking + [f"{row.estimator}: {_line(row)}." for row in rows]


def consistency(row: Row) -> str:
    """Return one clause on whether the covariance of an estimator agrees with its innovations."""
    if math.isnan(row.mean_nis):
        return "no covariance of the innovations, so nothing can be said about the bands"
    low, high = row.nis_band
    if low <= row.mean_nis <= high:
        return "consistent, its innovations are as large as it predicts"
    ratio = math.sqrt(row.mean_nis / row.nis_expected)
    size = f"{_compared(ratio)} it predicts"
    if abs(ratio - 1.0) < _CLOSE:
        return f"nearly consistent, its innovations are {size}"
    if ratio > 1:
        return f"over-confident, its innovations are {size} and its bands too narrow"
    return f"too cautious, its innovations are {size} and its bands too wide"


def _line(row: Row) -> str:
    if row.failed:
        return "diverged, its estimates are worthless; see the status"
    against = _against_reference(row)
    return f"{consistency(row)}; {against}" if against else consistency(row)


def _compared(ratio: float) -> str:
    if ratio >= 1.5:
        return f"{ratio:.1f} times as large as"
    change = significant(100.0 * abs(ratio - 1.0), 2)
    return f"{change} % {'larger' if ratio > 1 else 'smaller'} than"


def _against_reference(row: Row) -> str:
    known = {name: f for name, f in row.final.items() if f.reference is not None}
    outside = [name for name, f in known.items() if not f.deviations <= 3.0]
    if outside:
        return f"further than 3σ from the reference of {', '.join(outside)}"
    return "within 3σ of every reference" if known else ""


def _ranking(rows: Sequence[Row]) -> str:
    best, others = rows[0], rows[1:]
    if best.failed:
        return "All estimators diverged."
    if math.isnan(best.log_likelihood):
        return f"{best.estimator} has the smallest innovations; no estimator has a likelihood."
    margins = [best.log_likelihood - r.log_likelihood for r in others if not r.failed]
    known = [m for m in margins if not math.isnan(m)]
    lead = f", by {significant(min(known), 2)} in log-likelihood per sample" if known else ""
    return f"{best.estimator} explains the recording best{lead}."
