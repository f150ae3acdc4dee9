"""What to begin with: which column is which signal, how noisy it is, what is unknown."""

from collections.abc import Mapping

from backsight.data.listing import FileColumn, FileColumns
from backsight.errors import ProblemError
from backsight.problem.starting import names_of, noise_shown
from backsight.units import convertible
from backsight.workbench._choices import Choices, Quantity
from backsight.workbench._equations import EXAMPLE, Equations, read_equations
from backsight.workbench._gallery import GALLERY, OTHER, Constant, Load, Slot
from backsight.workbench._modelled import conversion_to, meant_unit

CHANGE = 0.1
"""A load changes within a second by this share of its size, to begin with."""

GUESS = 0.3
"""How wrong the guess of a constant may be, by its size: zero is beyond three of them."""


def suggested(machine: str, found: FileColumns) -> Choices:
    """Return what the page shows when a machine is chosen.

    Columns are told by their units, then by their names. Of a column whose unit is not that of the
    signal none is proposed.
    """
    if machine == OTHER or machine not in GALLERY:
        return Choices(title=found.path.stem, machine=OTHER, equations=EXAMPLE)
    chosen = GALLERY[machine]
    columns = _matched((*chosen.inputs, *chosen.outputs), found)
    inputs = {s.name: columns[s.name] for s in chosen.inputs if s.name in columns}
    outputs = {s.name: columns[s.name] for s in chosen.outputs if s.name in columns}
    return Choices(
        title=f"{found.path.stem}: {chosen.title.lower()}",
        machine=machine,
        inputs=inputs,
        outputs=outputs,
        quantities=_quantities(chosen.constants, chosen.loads),
        noise=noises(outputs, {s.name: s.unit for s in chosen.outputs}, found),
    )


def completed(choices: Choices, found: FileColumns) -> Choices:
    """Return the choices with what new columns and equations ask for, and without what is gone."""
    units = {name: found[column].unit for name, column in choices.outputs.items()}
    quantities = dict(choices.quantities)
    if choices.machine in GALLERY:
        units = {s.name: s.unit for s in GALLERY[choices.machine].outputs}
    else:
        try:
            equations = read_equations(choices.equations)
        except ProblemError:
            equations = Equations({}, {})
        names = equations.constants(choices.inputs)
        quantities = {name: quantities.get(name, Quantity(value=1.0)) for name in names}
    known = noises(choices.outputs, units, found)
    noise = {name: choices.noise.get(name, value) for name, value in known.items()}
    return choices.model_copy(update={"noise": noise, "quantities": quantities})


def proper_names(found: FileColumns) -> dict[str, str]:
    """Column to the name that a signal of the user's own model may have."""
    return names_of([column.name for column in found.signals])


def noises(
    outputs: Mapping[str, str], units: Mapping[str, str], found: FileColumns
) -> dict[str, float]:
    """Standard deviation of the noise of every output [its unit], as the samples show it."""
    columns = {name: found[column] for name, column in outputs.items() if column in found}
    noise = {
        n: noise_shown(c) * abs(conversion_to(units.get(n, ""), c).factor)
        for n, c in columns.items()
    }
    return {name: float(f"{value:.3g}") if value > 0 else 1e-6 for name, value in noise.items()}


def _quantities(constants: tuple[Constant, ...], loads: tuple[Load, ...]) -> dict[str, Quantity]:
    found = {
        c.name: Quantity(
            value=c.value,
            sigma=round(GUESS * c.value, 12) if c.unknown else None,
            lower=c.value / 1000 if c.positive else None,
            unit=c.unit,
        )
        for c in constants
    }
    return found | {
        load.name: Quantity(
            value=0.0, sigma=load.size, change=round(CHANGE * load.size, 12), unit=load.unit
        )
        for load in loads
    }


def _matched(slots: tuple[Slot, ...], found: FileColumns) -> dict[str, str]:
    """Slot to column, the best pairs first."""
    pairs = [
        (score, -i, -j, slot.name, column.name)
        for i, slot in enumerate(slots)
        for j, column in enumerate(found.signals)
        if (score := _likeness(slot, column)) > 0
    ]
    matched: dict[str, str] = {}
    for *_, slot, column in sorted(pairs, reverse=True):
        if slot not in matched and column not in matched.values():
            matched[slot] = column
    return matched


def _likeness(slot: Slot, column: FileColumn) -> int:
    name = column.name.lower()
    named = sum(word in name for word in slot.words)
    unit = meant_unit(column, slot.unit)
    if not unit:
        return named
    return 2 + named if convertible(unit, slot.unit) else 0
