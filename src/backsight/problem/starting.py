"""Write a problem file to start from, for a recording that was looked at."""

import math
import os
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from backsight.algebra.expressions import CONSTANTS, FUNCTIONS
from backsight.data.listing import FileColumn, FileColumns
from backsight.errors import DataError
from backsight.output import write_whole
from backsight.problem.spelling import as_key, as_table, as_value, in_quotes

MOST = 4
"""Signals that are outputs at once; the others are in comments."""

LEAST = 1e-4
"""Standard deviation of the noise of a signal that shows none, by its range."""

FINEST = 1e-6
"""Noise below this, by the range, is none but rounding; encoders of long axes come near to it."""


def write_start(
    found: FileColumns,
    path: str | os.PathLike[str],
    given: Mapping[str, str | int | None],
) -> Path:
    """Write a problem file that begins with the columns of a recording.

    Its model is that of no mechanics: every signal has a rate that walks at random, which smooths
    it. Noise and walk are those that the samples show. What is not known is in a comment.

    Parameters
    ----------
    found : FileColumns
        From `backsight.data.list_columns`.
    path : path
        Where to write; the recording is named relative to it.
    given : dict
        Keys of ``[recording]`` with which the file was listed; None: not given.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    DataError
        If the recording has no signal.
    OutputError
        If the file is there already, or cannot be written.
    """
    path = Path(path)
    text = _text(found, os.path.relpath(found.path, path.parent), path, given)
    return write_whole(path, text.encode("utf-8"), replace=False)


def _text(found: FileColumns, place: str, path: Path, given: Mapping[str, str | int | None]) -> str:
    names = names_of([column.name for column in found.signals])
    whole = [c for c in found.signals if _fault(c, found) == ""]
    chosen = whole[:MOST]
    if not chosen:
        raise DataError(f"{found.path}: there is no signal to begin with; see backsight columns")
    others = [c for c in found.signals if c not in chosen]
    head = [
        "# Written by backsight init. It runs as it is"
        + (":" if found.timed else " once the sampling period is filled in:"),
        f"#   backsight run {shlex.quote(path.name)} --out out",
        "# The model below smooths the signals; put that of your system in its place.",
        "",
        f"title = {in_quotes(found.path.stem)}",
        "",
        "[recording]",
        f"path = {in_quotes(place)}",
        *(f"{key} = {as_value(value)}" for key, value in given.items() if value is not None),
        *([f"missing = {list(found.codes)}"] if found.codes else []),
        *clock_lines(found),
        "# What drives the model (forces, voltages, motions of the ground) is an input:",
        f'# inputs.F = {{ column = {in_quotes((others or chosen)[0].name)}, unit = "N" }}',
        *(_output(c, names[c.name]) for c in chosen),
    ]
    for column in others:
        fault = _fault(column, found)
        head.append(f"# {_output(column, names[column.name])}{f'  # {fault}' if fault else ''}")
    return "\n".join([*head, "", *_model(chosen, names, found)]) + "\n"


def clock_lines(found: FileColumns) -> list[str]:
    """Lines of ``[recording]`` that say what its time is, or that nobody knows."""
    remarks = [f"# {remark}" for remark in found.remarks]
    if found.clock is None or not (found.sure or found.clock):
        if found.told is not None:
            return [f"dt = {found.told.dt!r}  # [s], since {found.told}; no column looks like time"]
        return ["# dt = ...  # no column looks like time: fill in the sampling period [s]"]
    if found.clock == "":
        return ["# The file knows the times of its samples.", *remarks]
    column = in_quotes(found.clock)
    if found.factor != 1.0:
        column = f"{{ column = {column}, factor = {found.factor!r} }}"
    lines = [*remarks, f"time = {column}"]
    if not found.sure:
        lines = [f"# time = {column}  # rises evenly: is it the time? Else fill in:", "# dt = ..."]
    if found.time_format:
        lines.append(f'time_format = "{found.time_format}"')
    if found.sure and not found.even:
        lines.append(f"grid = {found.dt!r}  # period [s]; in gaps nothing is measured")
    return lines


def _fault(column: FileColumn, found: FileColumns) -> str:
    """Why a signal is no output at once."""
    rate = max((c.rate for c in found.signals if not math.isnan(c.rate)), default=math.nan)
    rows = max(c.samples for c in found.signals)
    if math.isnan(column.low):
        return "nothing is measured"
    if column.low == column.high:
        return f"constant, {column.low:g}"
    if column.samples != rows or (found.clock == "" and abs(column.rate - rate) > 1e-6 * rate):
        return f"{column.samples} samples of another rate or time: a recording of its own"
    return ""


def _output(column: FileColumn, name: str) -> str:
    unit = f", unit = {in_quotes(column.unit)}" if column.unit else ""
    return f"outputs.{as_key(name)} = {{ column = {in_quotes(column.name)}{unit} }}"


def _model(
    columns: Sequence[FileColumn], names: Mapping[str, str], found: FileColumns
) -> list[str]:
    dt = found.dt if found.timed and found.dt > 0 else 1.0
    signals = {names[c.name]: c for c in columns}
    noise = {name: noise_shown(c) for name, c in signals.items()}
    walk = {f"{name}_rate": _walk(c, dt) for name, c in signals.items()}
    states = {name: c.unit for name, c in signals.items()}
    states |= {f"{name}_rate": f"{c.unit or '1'}/s" for name, c in signals.items()}
    start = {n: _rounded(2.0 * max(abs(c.low), abs(c.high))) for n, c in signals.items()}
    start |= {f"{n}_rate": _rounded((c.high - c.low) / dt) for n, c in signals.items()}
    return [
        "[model]",
        'kind = "equations"',
        f"states = {as_table(states)}",
        f"outputs = {as_table({name: name for name in signals})}",
        "",
        "[model.equations]",
        *(f'{as_key(name)} = "{name}_rate"' for name in signals),
        *(f'{as_key(f"{name}_rate")} = "0"' for name in signals),
        "",
        "[noise]",
        "# Of the measurement, as the samples show it; better from the sensor's data sheet.",
        f"sigma_y = {as_table(noise)}",
        "# By how much rates change from sample to sample: less smooths more, more follows faster.",
        f"sigma_w = {as_table(walk)}",
        "",
        "[prior]",
        f"sigma_x0 = {as_table(start)}",
        "",
        "[estimators.smoothed]",
        'kind = "kf"',
        "smooth = true",
    ]


def noise_shown(column: FileColumn) -> float:
    """Standard deviation of the noise, as the samples show it [unit of the column]."""
    span = column.high - column.low
    shown = column.noise > FINEST * span  # NaN is not
    return _rounded(column.noise if shown else LEAST * span)


def _walk(column: FileColumn, dt: float) -> float:
    """Change of the rate per sample; something, lest what is still now can never move."""
    return _rounded(max(column.walk, 0.01 * noise_shown(column)) / dt)


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def names_of(columns: Iterable[str]) -> dict[str, str]:
    """Names of signals for columns: those that a formula can have, all different."""
    names: dict[str, str] = {}
    taken = {*FUNCTIONS, *CONSTANTS}
    for column in columns:
        last = re.sub(r"\W+", "_", column.replace("/", "_") if column in names else column)
        base = last.strip("_") or "y"
        base = f"y_{base}" if base[0].isdigit() else base
        name, k = base, 2
        while name in taken or f"{name}_rate" in taken:
            name, k = f"{base}_{k}", k + 1
        taken |= {name, f"{name}_rate"}
        names[column] = name
    return names
