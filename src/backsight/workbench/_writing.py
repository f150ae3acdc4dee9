"""From the choices on the page to the text of a problem file."""

import math
from collections.abc import Mapping

from backsight.data.listing import FileColumns
from backsight.errors import ProblemError, nearest
from backsight.problem.spelling import as_key, as_table, in_quotes
from backsight.problem.starting import clock_lines
from backsight.workbench._choices import METHODS, Choices, Quantity
from backsight.workbench._modelled import (
    Modelled,
    beginnings,
    conversion_to,
    meant_unit,
    modelled,
    period,
    scales,
)

INEXACT = 1e-6
"""What an equation of motion leaves out per sample, by the size of its state."""

_HEAD = """\
# Written by backsight open. The recording lies beside this file, or where its path says.
# Run it: backsight run FILE.toml --out out"""


def problem_text(
    choices: Choices, found: FileColumns, path: str, *, firsts: Mapping[str, float]
) -> str:
    """Return the problem file.

    Parameters
    ----------
    choices : Choices
    found : FileColumns
        The recording as it was listed.
    path : str
        Of the recording, as it stands in the file.
    firsts : dict
        Column to its first sample: what is measured begins there.

    Raises
    ------
    ProblemError
        If something is not chosen yet or the equations cannot be read.
    """
    model = modelled(choices, found)
    for name in choices.methods:
        if name not in METHODS:
            raise ProblemError(f"methods: unknown '{name}', {nearest(name, METHODS)}")
    if not choices.methods:
        raise ProblemError("methods: choose at least one estimator")
    known = {n: Quantity(value=0.0, unit=unit) for n, unit in model.constants.items()}
    known |= {n: q for n, q in choices.quantities.items() if n in model.constants}
    lines = [_HEAD, "", f"title = {in_quotes(choices.title or found.path.stem)}", ""]
    lines += [*_recording(model, choices, found, path), "", *_model(model, known), ""]
    unknown = {n: q for n, q in known.items() if q.sigma is not None}
    if unknown:
        lines += ["[estimate]             # a guess, and how wrong it may be"]
        lines += [_estimate(n, q, period(choices, found)) for n, q in unknown.items()] + [""]
    sizes, begin = scales(model, choices, found), beginnings(model, choices, found, firsts)
    wrong = sizes | {n: sigma for n, (_, sigma) in begin.items()}
    inexact = {n: float(f"{INEXACT * sizes[n]:.3g}") for n in model.moving}
    noise = {n: choices.noise[n] for n in model.outputs if n in choices.noise}
    start = {n: value for n, (value, _) in begin.items()}
    lines += ["[prior]", *([f"x0 = {as_table(start)}"] if start else [])]
    lines += [f"sigma_x0 = {as_table(wrong)}", "", "[noise]"]
    lines += [f"sigma_y = {as_table(noise)}", f"sigma_w = {as_table(inexact)}"]
    for name in choices.methods:
        lines += ["", f"[estimators.{name}]", METHODS[name]]
    return "\n".join(lines) + "\n"


def _recording(model: Modelled, choices: Choices, found: FileColumns, path: str) -> list[str]:
    time = clock_lines(found)
    if choices.dt is not None:
        time = [f"dt = {choices.dt!r}"]
    elif choices.time:
        time = [f"time = {in_quotes(choices.time)}"]
    return [
        "[recording]",
        f"path = {in_quotes(path)}",
        *([f"missing = {list(found.codes)}"] if found.codes else []),
        *time,
        *_columns("inputs", model.inputs, choices.inputs, found),
        *_columns("outputs", model.outputs, choices.outputs, found),
    ]


def _columns(
    kind: str, units: Mapping[str, str], columns: Mapping[str, str], found: FileColumns
) -> list[str]:
    lines = []
    for name, unit in units.items():
        entries: dict[str, str | float] = {"column": columns[name]}
        if unit:
            entries["unit"] = unit
        column = found[columns[name]]
        way = conversion_to(unit, column)
        # What the reader does not see in the file by itself is said.
        if not way.same and meant_unit(column, unit) != column.unit:
            entries["factor"] = float(f"{way.factor:.15g}")
        lines.append(f"{kind}.{as_key(name)} = {as_table(entries)}")
    return lines


def _model(model: Modelled, known: Mapping[str, Quantity]) -> list[str]:
    fixed = [
        f"{as_key(n)} = {as_table({'value': q.value} | ({'unit': q.unit} if q.unit else {}))}"
        for n, q in known.items()
        if q.sigma is None
    ]
    return [
        "[model]",
        'kind = "equations"',
        f"states = {as_table(model.states)}",
        f"outputs = {as_table(model.formulas)}",
        "",
        "[model.equations]",
        *(f"{as_key(name)} = {in_quotes(rate)}" for name, rate in model.rates.items()),
        *(["", "[model.parameters]", *fixed] if fixed else []),
    ]


def _estimate(name: str, quantity: Quantity, dt: float) -> str:
    entries: dict[str, str | float] = {"start": quantity.value, "sigma": quantity.sigma or 0.0}
    if quantity.change:
        entries["walk"] = float(f"{quantity.change * math.sqrt(dt):.3g}")
    elif quantity.lower is not None:
        entries["lower"] = quantity.lower
    if quantity.unit:
        entries["unit"] = quantity.unit
    return f"{as_key(name)} = {as_table(entries)}"
