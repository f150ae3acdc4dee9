"""What the comparison table means, in words."""

import math
from collections.abc import Sequence
from typing import Literal

from backsight.analysis.comparison.row import Row
from backsight.analysis.consistency import cause, pattern
from backsight.analysis.forces import largest_of
from backsight.analysis.outliers import sentences
from backsight.rounding import significant
from backsight.schema import Status

Light = Literal["good", "fair", "bad"]
"""Believe it; believe it with the reservation that is said; do not believe it."""

_CLOSE = 0.10
"""Innovations that are so much larger or smaller than predicted do no harm in practice."""

TIE = 1e-6
"""A lead in log-likelihood per sample below this is rounding, or means nothing."""

_FINE = "consistent, its innovations are as large as it predicts"
_ONLY_SIZE = "; no more than their size is judged, since its gain correlates them"


def verdicts(rows: Sequence[Row]) -> list[str]:
    """Return a few lines: the recording, the ranking, consistency and final errors of each.

    Parameters
    ----------
    rows : sequence of Row
        As `ranked_table` gives them, best first.
    """
    ranking = [ranking_sentence(rows)] if len(rows) > 1 else []
    recording = list(rows[0].alignment) if rows else []
    return recording + ranking + [f"{row.estimator}: {sentence(row)}." for row in rows]


def agreement(row: Row) -> str:
    """Return a clause or two on whether an estimator agrees with its own covariances, and why not.

    Sizes of innovations are judged by `mean_nis`, their pattern and the cause by
    `backsight.analysis.consistency._causes`.
    """
    if math.isnan(row.mean_nis):
        return "no covariance of the innovations, so nothing can be said about the bands"
    if row.hits is not None:
        return _beside_forces(row)
    found = row.consistency
    if found.consistent:
        alone = found.kind == "coloured" and found.noise is None
        return f"{_FINE}{_ONLY_SIZE if alone else ''}"
    clauses = [_size(row) or "inconsistent, although its innovations are as large as it predicts"]
    clauses += [text for text in (pattern(found), cause(found, row.aligned)) if text]
    return "; ".join(clauses)


def light(row: Row) -> Light:
    """Return whether an estimate may be believed: a traffic light for `sentence`."""
    if row.failed or row.coarse or Status.MISLED.name in row.status:
        return "bad"
    if math.isnan(row.mean_nis) or row.doubts:
        return "fair"
    if row.hits is not None:
        text = _beside_forces(row)
        return "bad" if text.startswith("over-confident") else "good" if text == _FINE else "fair"
    if row.consistency.consistent:
        return "good"
    over = math.sqrt(row.mean_nis / row.nis_expected) - 1.0
    return "bad" if over > _CLOSE and not row.consistency.sized else "fair"


def _beside_forces(row: Row) -> str:
    """Return what innovations say that contain forces which are not known yet.

    That they are large says nothing of the noise then, nor does how they hang together. Remarks
    tell of forces that are too small for the settings.
    """
    acted = bool(row.remarks) or (row.hits is not None and bool(row.hits.hits))
    if acted and row.mean_nis > row.consistency.nis_band[1]:
        ratio = math.sqrt(row.mean_nis / row.nis_expected)
        return (
            f"its innovations contain the unknown forces and are {_compared(ratio)} it predicts "
            "without them, which says nothing about the bands"
        )
    return _size(row) or _FINE


def _size(row: Row) -> str:
    """Return what the size of the innovations means; empty if it is as predicted."""
    if row.consistency.sized:
        return ""
    ratio = math.sqrt(row.mean_nis / row.nis_expected)
    size = f"{_compared(ratio)} it predicts"
    if abs(ratio - 1.0) < _CLOSE:
        return f"nearly consistent, its innovations are {size}"
    if ratio > 1:
        return f"over-confident, its innovations are {size} and its bands too narrow"
    return f"too cautious, its innovations are {size} and its bands too wide"


def sentence(row: Row) -> str:
    """Return what is to be said of one estimator, without its name."""
    if row.failed:
        failed = "diverged, its estimates are worthless; see the status"
        return f"{row.coarse}; {failed}" if row.coarse else failed
    against = _against_reference(row)
    found = str(row.hits) if row.hits is not None and not row.remarks else ""
    if row.fitted_hits:
        found = largest_of(row.fitted_hits)
    clauses = (
        row.coarse,
        found,
        agreement(row),
        against,
        *row.remarks,
        *row.doubts,
        *sentences(row.outliers),
    )
    return "; ".join(text for text in clauses if text)


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


def ranking_sentence(rows: Sequence[Row]) -> str:
    """Return who explains the recording best, or that several do it equally well."""
    best, others = rows[0], rows[1:]
    if best.failed:
        return "All estimators diverged."
    if math.isnan(best.log_likelihood):
        return f"{best.estimator} has the smallest innovations; no estimator has a likelihood."
    sound = [r for r in others if not r.failed]
    alike = [r.estimator for r in sound if best.log_likelihood - r.log_likelihood < TIE]
    if alike:
        rest = ", better than the others" if len(alike) < len(others) else ""
        return f"{_listed([best.estimator, *alike])} explain the recording equally well{rest}."
    margins = [best.log_likelihood - r.log_likelihood for r in sound]
    known = [m for m in margins if not math.isnan(m)]
    lead = f", by {significant(min(known), 2)} in log-likelihood per sample" if known else ""
    forced = any(row.hits is not None and row.hits.hits for row in rows)
    late = "; forces that are found afterwards do not count in it" if forced else ""
    return f"{best.estimator} explains the recording best{lead}{late}."


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"
