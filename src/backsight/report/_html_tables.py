"""The page's tables as HTML; every text from outside is escaped here."""

import math
from collections.abc import Mapping, Sequence
from html import escape

from backsight.analysis.comparison import Final, Row
from backsight.report._series import Series, quantity
from backsight.rounding import grouped, percent, plus_minus, shortest, significant
from backsight.schema import STATUS_TEXT, Status


def comparison(rows: Sequence[Row], every: Sequence[Series], outputs: Mapping[str, str]) -> str:
    """One line per estimator, best first."""
    head = ["rank", "estimator", "log-likelihood<small>per sample</small>"]
    head += [f"mean NIS<small>{_expected(rows[0])}</small>"]
    head += [
        f"RMS innovation<small>{escape(quantity(name, unit))}</small>"
        for name, unit in outputs.items()
    ]
    head += ["time<small>µs per sample</small>", "status"]
    marks = {s.name: swatch(s) for s in every}
    body = [
        [
            str(rank),
            f"{marks[row.estimator]}{escape(row.estimator)}",
            significant(row.log_likelihood, 5),
            f"{significant(row.mean_nis, 4)}<small>{_interval(row)}</small>",
            *(significant(row.rms_innovation.get(name, float("nan"))) for name in outputs),
            significant(row.us_per_sample, 3),
            _status(row),
        ]
        for rank, row in enumerate(rows, 1)
    ]
    return table("comparison", head, body, caption="Over the whole recording")


def consistency_table(rows: Sequence[Row], every: Sequence[Series]) -> str:
    """What is left in the innovations: one line per estimator and output."""
    head = ["estimator", "output", "correlation<small>of successive innovations</small>"]
    head += ["explained<small>by past inputs</small>", "within 3σ<small>ideal: 99.7 %</small>"]
    head += ["R should be<small>times the assumed</small>", "Q should be<small>the same</small>"]
    marks = {s.name: swatch(s) for s in every}
    body = [
        [
            f"{marks[row.estimator]}{escape(row.estimator)}",
            escape(c.output),
            significant(c.lag1, 2),
            _share(c.explained),
            _share(row.consistency.innovations.get(c.output, (float("nan"),) * 3)[2]),
            *_factors(row),
        ]
        for row in rows
        for c in row.consistency.colours
    ]
    return table("consistency", head, body, caption="Innovations over the whole recording")


def final_values_table(
    rows: Sequence[Row], every: Sequence[Series], states: Mapping[str, str]
) -> str:
    """Last estimate of every state, one column per estimator."""
    references = {
        name: final.reference
        for row in rows
        for name, final in row.final.items()
        if final.reference is not None
    }
    marks = {s.name: swatch(s) for s in every}
    head = ["state", *(f"{marks[row.estimator]}{escape(row.estimator)}" for row in rows)]
    head += ["reference"] if references else []
    body = []
    for name, unit in states.items():
        cells = [_label(name, unit), *(_final(row, name) for row in rows)]
        if references:
            known = name in references
            cells.append(shortest(references[name]) if known else "")
        body.append(cells)
    return table("final", head, body, caption="At the last sample")


def virtual_table(rows: Sequence[Row], every: Sequence[Series]) -> str:
    """Quantities without a sensor over the recording; nothing if there are none."""
    marks = {s.name: swatch(s) for s in every}
    found = [(row, name, v) for row in rows for name, v in row.virtual.items()]
    if not found:
        return ""
    head = ["estimator", "virtual output", "RMS", "largest", "typical σ"]
    body = [
        [
            f"{marks[row.estimator]}{escape(row.estimator)}",
            _label(name, v.unit),
            significant(v.rms, 3),
            significant(v.largest, 3),
            significant(v.typical_std, 2),
        ]
        for row, name, v in found
    ]
    if any(v.within for _, _, v in found):
        head += ["RMS error<small>against truth</small>", "within 3σ<small>ideal: 99.7 %</small>"]
        for cells, (_, _, v) in zip(body, found, strict=True):
            cells += [significant(v.rms_error, 2), _share(v.within[2] if v.within else math.nan)]
    return table("virtual", head, body, caption="Quantities without a sensor")


def status_list(rows: Sequence[Row]) -> str:
    """Cause and remedy of everything that occurred."""
    items = [
        f"<li><b>{escape(row.estimator)}</b>: {_count(row, bit)}: {escape(text)}.</li>"
        for row in rows
        for bit, text in STATUS_TEXT.items()
        if bit.name in row.status
    ]
    return f"<ul>{''.join(items)}</ul>" if items else "<p>Nothing to report.</p>"


def swatch(s: Series) -> str:
    """Return a small stroke in the colour and line style of an estimator."""
    style = {"solid": "solid", "dash": "dashed", "dot": "dotted"}[s.dash]
    return f'<i class="stroke" style="border-top: 3px {style} var({s.colour})"></i>'


def table(name: str, head: Sequence[str], body: Sequence[Sequence[str]], *, caption: str) -> str:
    """Return a table; cells, head and caption are HTML already.

    It can have the focus: where it is too wide, keys scroll it.
    """
    top = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    lines = "".join(f"<tr>{''.join(f'<td>{c}</td>' for c in cells)}</tr>" for cells in body)
    return (
        f'<div class="scroll" tabindex="0"><table class="{name}"><caption>{caption}</caption>'
        f"<thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


def _share(value: float) -> str:
    return f"{significant(100 * value, 3)} %" if math.isfinite(value) else significant(value)


def _factors(row: Row) -> list[str]:
    """Factors of R and Q; not known where the theory does not apply."""
    noise = row.consistency.noise
    if noise is None:
        return [significant(math.nan)] * 2
    return [plus_minus(noise.R, noise.R_std), plus_minus(noise.Q, noise.Q_std)]


def _label(name: str, unit: str) -> str:
    return f"{escape(name)} <small>{escape(unit)}</small>" if unit else escape(name)


def _expected(row: Row) -> str:
    return f"ideal: {significant(row.nis_expected, 3)}"


def _interval(row: Row) -> str:
    low, high = row.nis_band
    return f"{significant(low, 4)} to {significant(high, 4)}"


def _final(row: Row, name: str) -> str:
    final = row.final.get(name)
    if final is None:
        return ""
    notes = [_error(final)] if final.reference is not None else []
    if name in row.rms_error:
        notes.append(f"RMS error {significant(row.rms_error[name], 3)}")
    small = f"<small>{'; '.join(notes)}</small>" if notes else ""
    return f"{final.shown}{small}"


def _error(final: Final) -> str:
    size = (
        f"{percent(final.relative_error)}, {significant(final.deviations, 2)} σ"
        if final.reference
        else f"{significant(final.error, 2)}, {significant(final.deviations, 2)} σ"
    )
    return f'<b class="bad">{size}</b>' if final.deviations > 3.0 else size


def _status(row: Row) -> str:
    parts = [_count(row, bit) for bit in Status if bit.name in row.status and bit]
    return "<br>".join(parts) if parts else "nothing to report"


def _count(row: Row, bit: Status) -> str:
    count, total = row.status[str(bit.name)], row.samples
    name = str(bit.name).replace("_", " ").lower()
    return f"{name} at {grouped(count)} of {grouped(total)} samples"
