"""The model that a user has chosen: a machine of the gallery, or equations of his own."""

import dataclasses
import math
from collections.abc import Mapping

from backsight.data.listing import FileColumn, FileColumns
from backsight.errors import ProblemError, nearest
from backsight.units import Conversion, UnitError, conversion, convertible, is_unit
from backsight.workbench._choices import Choices
from backsight.workbench._equations import read_equations
from backsight.workbench._gallery import GALLERY, OTHER

DOUBT = 20.0
"""Standard deviations of the noise by which the beginning of a measured state may be wrong."""

_PER_MINUTE = {"1/min", "min-1", "min^-1", "min⁻¹", "/min"}
"""How loggers write revolutions per minute; the reader takes them for plain numbers."""


@dataclasses.dataclass(frozen=True)
class Modelled:
    """Equations with the units of their signals.

    Parameters
    ----------
    states : dict
        Name to unit.
    rates : dict
        State to the formula of its rate.
    moving : tuple of str
        States whose equation may be wrong a little; the others are integrals.
    inputs, outputs : dict
        Name to unit.
    formulas : dict
        Output to its formula.
    constants : dict
        Every other name in the equations to its unit, "" if that is not known.
    """

    states: Mapping[str, str]
    rates: Mapping[str, str]
    moving: tuple[str, ...]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    formulas: Mapping[str, str]
    constants: Mapping[str, str]


def modelled(choices: Choices, found: FileColumns) -> Modelled:
    """Return the model of the choices.

    Raises
    ------
    ProblemError
        If there is no such machine, no output is measured, or the equations cannot be read.
    """
    if not choices.outputs:
        raise ProblemError("outputs: say of at least one column that it is an output")
    for name, column in {**choices.inputs, **choices.outputs}.items():
        if column not in found:
            raise ProblemError(f"{name}: the recording has no column '{column}'")
    if choices.machine == OTHER:
        return _own(choices, found)
    if choices.machine not in GALLERY:
        raise ProblemError(f"machine: unknown '{choices.machine}', {nearest('', GALLERY)}")
    return _of_gallery(choices)


def _of_gallery(choices: Choices) -> Modelled:
    machine = GALLERY[choices.machine]
    measured = {slot.name: slot for slot in machine.outputs if slot.name in choices.outputs}
    optional = {name for slot in machine.outputs for name in slot.needs}
    needed = {name for slot in measured.values() for name in slot.needs}
    states = {n: s for n, s in machine.states.items() if n not in optional or n in needed}
    driven = {slot.name: slot.unit for slot in machine.inputs}
    constants = {c.name: c.unit for c in (*machine.constants, *machine.loads)}
    constants |= {n: unit for n, unit in driven.items() if n not in choices.inputs}
    return Modelled(
        states={n: s.unit for n, s in states.items()},
        rates={n: s.rate for n, s in states.items()},
        moving=tuple(n for n, s in states.items() if s.motion),
        inputs={n: unit for n, unit in driven.items() if n in choices.inputs},
        outputs={n: slot.unit for n, slot in measured.items()},
        formulas={n: slot.formula for n, slot in measured.items()},
        constants=constants,
    )


def _own(choices: Choices, found: FileColumns) -> Modelled:
    equations = read_equations(choices.equations)
    for name in choices.outputs:
        if name not in equations.outputs:
            raise ProblemError(
                f"equations: the output '{name}' has no equation; write {name} = formula"
            )
    outputs = {name: found[column].unit for name, column in choices.outputs.items()}
    states = equations.units(outputs)
    return Modelled(
        states=states,
        rates=equations.rates,
        moving=tuple(n for n, rate in equations.rates.items() if rate not in equations.rates),
        inputs={name: found[column].unit for name, column in choices.inputs.items()},
        outputs=outputs,
        formulas={name: equations.outputs[name] for name in choices.outputs},
        constants=dict.fromkeys(equations.constants(choices.inputs), ""),
    )


def meant_unit(column: FileColumn, wanted: str) -> str:
    """Unit of a column that is to become a signal in the unit that is `wanted`.

    That of the file; else the end of the name, as in ``force_N``, if it is a unit of the same kind;
    "" if neither. The reader takes no name for granted, which may end in anything; here it is known
    what the signal measures, and what was understood is shown.
    """
    if column.unit in _PER_MINUTE and wanted and convertible("rpm", wanted):
        return "rpm"
    if column.unit:
        return column.unit
    ending = named_unit(column)
    return ending if ending and wanted and convertible(ending, wanted) else ""


def named_unit(column: FileColumn) -> str:
    """Unit in which the name of a column ends, as in ``force_N``; "" if it ends in none."""
    before, _, ending = column.name.rpartition("_")
    return ending if before and is_unit(ending) else ""


def conversion_to(unit: str, column: FileColumn) -> Conversion:
    """From the unit of a column to that of its signal; none where there is no way or no unit."""
    own = meant_unit(column, unit)
    if not unit or not own:
        return Conversion(1.0)
    try:
        return conversion(own, unit)
    except UnitError:
        return Conversion(1.0)


def remarks_on(column: FileColumn) -> list[str]:
    """Say what was understood of the unit."""
    if column.unit in _PER_MINUTE:
        return ["revolutions per minute, where a speed of rotation is meant"]
    ending = "" if column.unit else named_unit(column)
    return [f"in {ending} by its name, where that fits"] if ending else []


def beginnings(
    model: Modelled, choices: Choices, found: FileColumns, firsts: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Of every state that is measured its first sample and how wrong that may be [its unit].

    This counts the first sample twice; `DOUBT` makes the second time not matter.
    """
    begin = {}
    for name, formula in model.formulas.items():
        first = firsts.get(choices.outputs[name], math.nan)
        if formula in model.states and name in choices.noise and math.isfinite(first):
            way = conversion_to(model.outputs[name], found[choices.outputs[name]])
            value = way.factor * first + way.offset
            begin[formula] = float(f"{value:.6g}"), float(f"{DOUBT * choices.noise[name]:.3g}")
    return begin


def scales(model: Modelled, choices: Choices, found: FileColumns) -> dict[str, float]:
    """How large every state may be: twice what its column shows, or by way of rates and integrals.

    Between a signal and its rate lies the geometric mean of the sampling period and the duration.
    """
    between = math.sqrt(period(choices, found) ** 2 * max(c.samples for c in found.signals))
    known: dict[str, float] = {}
    for name, formula in model.formulas.items():
        column = found[choices.outputs[name]]
        size = (
            2.0
            * max(abs(column.low), abs(column.high))
            * abs(conversion_to(model.outputs[name], column).factor)
        )
        if formula in model.states:
            known.setdefault(formula, size)
        for state, rate in model.rates.items():
            if rate == formula:
                known.setdefault(state, size * between)
    for _ in model.states:
        for state, rate in model.rates.items():
            if state in known and rate in model.states:
                known.setdefault(rate, known[state] / between)
            elif rate in known:
                known.setdefault(state, known[rate] * between)
    known = {name: size for name, size in known.items() if math.isfinite(size) and size > 0}
    return {name: float(f"{known.get(name, 1.0):.3g}") for name in model.states}


def period(choices: Choices, found: FileColumns) -> float:
    """Sampling period [s]; 1 as long as nobody knows it."""
    if choices.dt is not None:
        return choices.dt
    return found.dt if found.dt > 0 else 1.0
