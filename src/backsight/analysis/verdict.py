"""What the comparison table means, in words."""

import math
from collections.abc import Sequence

from backsight.analysis.rounding import significant
from backsight.analysis.summary import Row

_CLOSE = 0.10
"""Innovations that are so much larger or smaller than predicted do no harm in practice."""


def verdicts(rows: Sequence[Row]) -> list[str]:
    """Return a few sentences: the ranking, then consistency and final errors of each.

    Parameters
    ----------
    rows : sequence of Row
        As `ranked_table` gives them, best first.
    """
    ranking = [_ranking(rows)] if len(rows) > 1 else []
    sentences = [f"{row.estimator} {consistency(row)}." for row in rows]
    return ranking + sentences + [s for row in rows if (s := _against_reference(row))]


def consistency(row: Row) -> str:
    """Return one clause on whether the covariance of an estimator agrees with its innovations."""
    if row.failed:
        return "diverged; its estimates are worthless (see the status)"
    if math.isnan(row.mean_nis):
        return "gives no covariance of its innovations: nothing can be said about its bands"
    low, high = row.nis_band
    if low <= row.mean_nis <= high:
        return "is consistent: the size of its innovations agrees with their covariance"
    ratio = math.sqrt(row.mean_nis / row.nis_expected)
    change = f"{significant(100.0 * abs(ratio - 1.0), 2)} %" if ratio < 2 else f"{ratio:.1f} times"
    if abs(ratio - 1.0) < _CLOSE:
        word = "larger" if ratio > 1 else "smaller"
        return f"is nearly consistent: its innovations are {change} {word} than it predicts"
    if ratio > 1:
        return (
            f"is over-confident: its innovations are {change} larger than it predicts, "
            "so its bands are too narrow"
        )
    return (
        f"is too cautious: its innovations are {change} smaller than it predicts, "
        "so its bands are too wide"
    )


def _against_reference(row: Row) -> str:
    known = {name: f for name, f in row.final.items() if f.reference is not None}
    if not known or row.failed:
        return ""
    outside = [name for name, f in known.items() if not f.deviations <= 3.0]
    if not outside:
        return f"{row.estimator} ends within 3σ of every reference value."
    return f"{row.estimator} ends further than 3σ from the reference value of {', '.join(outside)}."


def _ranking(rows: Sequence[Row]) -> str:
    best, others = rows[0], rows[1:]
    if best.failed:
        return "All estimators diverged."
    if math.isnan(best.log_likelihood):
        return f"{best.estimator} has the smallest innovations."
    margins = [best.log_likelihood - r.log_likelihood for r in others if not r.failed]
    comparable = [m for m in margins if not math.isnan(m)]
    if not comparable:
        return f"{best.estimator} comes first: no other one has a likelihood."
    return (
        f"{best.estimator} explains the recording best: its log-likelihood per sample is "
        f"{significant(min(comparable), 2)} above the next."
    )
