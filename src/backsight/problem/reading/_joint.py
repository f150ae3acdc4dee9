"""The model of a problem file, with what is unknown among its states."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from backsight.algebra.expressions import expression
from backsight.errors import ProblemError, nearest
from backsight.models.augment import augment
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.models.views.sensors import Sensor, with_sensors
from backsight.models.views.virtual import with_dummies, with_virtual
from backsight.problem.reading._forces import of_mean, process_of, with_moving
from backsight.problem.reading._model_table import RestOfFile
from backsight.problem.reading.checking import at, shown_value, validated
from backsight.problem.reading.kinds import ALL_KINDS
from backsight.problem.reading.tables import (
    ColumnTable,
    EstimateTable,
    ProblemTable,
    ReadingsTable,
    SensorColumnTable,
    VirtualTable,
)
from backsight.units import check_unit, convertible


def joint_model(table: ProblemTable, folder: Path) -> Model:
    """Build the model and make states of the parameters and disturbances to estimate.

    Files of the model are looked for in the folder.

    Raises
    ------
    ProblemError
        With the key of what is wrong.
    """
    _check_sources(table)
    _check_units(table)
    columns = table.recording.columns
    moved = with_moving(_plain(table, folder), table)
    plain = _with_sensors(_read_through(moved, table.readings), columns("outputs"))
    _check_columns(plain.inputs, columns("inputs"), "input")
    _check_columns(plain.outputs, columns("outputs"), "output")
    if table.recording.high_pass is not None:
        with at("recording.high_pass needs a linear model"):
            state_space(plain)
    parameters = [s.name for s in plain.parameters]
    for name in table.estimate:
        if name not in parameters:
            hint = nearest(name, parameters)
            raise ProblemError(f"estimate.{name}: the model has no parameter '{name}', {hint}")
    states = [s.name for s in plain.states]
    for name, entry in table.disturbances.items():
        if entry.acts_on not in states:
            hint = nearest(entry.acts_on, states)
            raise ProblemError(f"disturbances.{name}.acts_on: no state '{entry.acts_on}', {hint}")
    forces = {name: process_of(name, entry) for name, entry in table.forces.items()}
    added = {n: e.acts_on for n, e in table.forces.items() if e.acts_on is not None}
    for name in forces:
        if name in table.estimate or name in table.disturbances:
            raise ProblemError(f"forces.{name}: is unknown twice; leave out one of the two")
        if name not in added and name not in parameters:
            raise ProblemError(
                f"forces.{name}: the model has no parameter '{name}', {nearest(name, parameters)}; "
                "or say which state it acts on: acts_on"
            )
    for name, state in added.items():
        if table.forces[name].mean:
            raise ProblemError(f"forces.{name}.mean: is for parameters of the model, not acts_on")
        if state not in states:
            hint = nearest(state, states)
            raise ProblemError(f"forces.{name}.acts_on: no state '{state}', {hint}")
    gaps = table.recording.gaps
    for name in gaps:
        if name in columns("outputs"):
            raise ProblemError(f"recording.inputs.{name}.gaps: '{name}' is an output, too")
    with at("estimate"):
        described = dataclasses.replace(
            plain,
            parameters=of_mean(_described(plain.parameters, table.estimate), table.forces),
        )
    walking = {name: entry.acts_on for name, entry in table.disturbances.items()}
    with at("forces" if forces else "estimate"):
        joint = augment(
            described,
            list(table.estimate),
            disturbances=walking | added,
            forces=forces,
            inputs=list(gaps),
        )
        told = _described(joint.states, {**table.disturbances, **gaps})
        joint = dataclasses.replace(joint, states=told)
    model = _with_formulas(joint, {**table.virtual, **table.dummy})
    with at("dummy"):
        return with_dummies(model, list(table.dummy))


def _plain(table: ProblemTable, folder: Path) -> Model:
    given = dict(table.model)
    kind = given.pop("kind", None)
    if kind is None:
        raise ProblemError(f"model.kind: is missing; known: {', '.join(sorted(ALL_KINDS))}")
    if not isinstance(kind, str):
        raise ProblemError(f"model.kind: must be text in quotes, not {shown_value(kind)}")
    if kind not in ALL_KINDS:
        raise ProblemError(f"model.kind: unknown kind '{kind}', {ALL_KINDS.hint(kind)}")
    with at("model.kind"):
        described = ALL_KINDS[kind]
    twice = [name for name in table.dummy if name in table.virtual]
    if twice:
        raise ProblemError(f"dummy.{twice[0]}: is the name of a virtual output, too")
    for key, entries in (("virtual", table.virtual), ("dummy", table.dummy)):
        _check_virtual(entries, key, kind, places=described.has_places)
    placed = {n: (v.kind, v.at) for n, v in {**table.virtual, **table.dummy}.items() if v.placed}
    with at("model"), ALL_KINDS.blamed(kind):
        return validated(described, given, where="model").build(
            RestOfFile(
                virtual=placed,
                inputs={n: c.unit for n, c in table.recording.columns("inputs").items()},
                outputs={n: c.unit for n, c in table.recording.columns("outputs").items()},
                start={name: entry.start for name, entry in table.estimate.items()}
                | {n: e.mean for n, e in table.forces.items() if e.acts_on is None},
                folder=folder,
            )
        )


def _read_through(model: Model, table: ReadingsTable) -> Model:
    """The model with the sensors of ``[readings]``."""
    if not table.outputs:
        return model
    sensors = {}
    for name, entry in table.outputs.items():
        with at(f"readings.outputs.{name}"):
            sensors[name] = Sensor(**entry.model_dump(exclude_none=True))
    with at("readings"):
        return with_sensors(model, sensors, dt=table.dt, parts=table.parts)


def _with_sensors(model: Model, columns: Mapping[str, ColumnTable]) -> Model:
    """Outputs with what is known of their sensors: whether they start anew, and their steps."""
    outputs = []
    for s in model.outputs:
        known = {}
        if isinstance(column := columns.get(s.name), SensorColumnTable):
            if column.wrap is not None:
                known["wrap"] = _number(column.wrap, f"recording.outputs.{s.name}.wrap")
            if column.resolution is not None:
                known["resolution"] = column.resolution
            if column.saturation is not None:
                known["saturation"] = tuple(column.saturation)
        with at(f"recording.outputs.{s.name}"):
            outputs.append(dataclasses.replace(s, **known))
    return dataclasses.replace(model, outputs=tuple(outputs))


def _number(given: float | str, where: str) -> float:
    """A number, or one as text such as "2*pi"."""
    if not isinstance(given, str):
        return given
    with at(where):
        return float(expression(given, {}, where="the number"))


def _check_virtual(
    virtual: Mapping[str, VirtualTable], key: str, kind: str, *, places: bool
) -> None:
    """Raise `ProblemError` if a virtual output is neither a formula nor at a place, or both."""
    for name, entry in virtual.items():
        where = f"{key}.{name}"
        if entry.placed == (entry.expression is not None):
            raise ProblemError(
                f"{where}: give either an expression, or kind and at like those of a sensor"
            )
        if not entry.placed:
            continue
        if not places:
            raise ProblemError(
                f"{where}.kind: a model of kind '{kind}' has no places; give an expression of its "
                "states, inputs and parameters"
            )
        if entry.kind is None or entry.at is None:
            raise ProblemError(f"{where}.{'kind' if entry.kind is None else 'at'}: is missing")


def _with_formulas(model: Model, virtual: Mapping[str, VirtualTable]) -> Model:
    """Add the virtual outputs that are formulas; all of them get the unit that the file gives.

    Dummy measurements are such outputs until `with_dummies` makes outputs of them.
    """
    formulas = {n: (v.expression, v.unit) for n, v in virtual.items() if v.expression is not None}
    with at("virtual"):
        made = with_virtual(model, formulas) if formulas else model
    if made.virtual is None:
        return made
    units = {name: entry.unit for name, entry in virtual.items() if entry.unit}
    signals = tuple(
        dataclasses.replace(s, unit=units.get(s.name, s.unit)) for s in made.virtual.signals
    )
    return dataclasses.replace(made, virtual=dataclasses.replace(made.virtual, signals=signals))


def _check_sources(table: ProblemTable) -> None:
    """Raise `ProblemError` if two files have the same signal, or one has none."""
    seen: dict[str, str] = {}
    for where, file in table.recording.files.items():
        if not file.inputs and not file.outputs:
            raise ProblemError(f"{where}: names no column as input or output")
        for kind in ("inputs", "outputs", "truth"):
            for name in getattr(file, kind):
                key = f"{kind}.{name}"
                if key in seen:
                    raise ProblemError(f"{where}.{key}: is a column of {seen[key]}, too")
                seen[key] = where


def _check_units(table: ProblemTable) -> None:
    """Raise `ProblemError` if the unit of a column, an unknown or a state is none."""
    units: dict[str, object] = {
        f"{where}.{kind}.{name}.unit": column.unit
        for where, file in table.recording.files.items()
        for kind in ("inputs", "outputs", "truth")
        for name, column in getattr(file, kind).items()
    }
    for kind in ("estimate", "disturbances", "virtual", "dummy"):
        units |= {f"{kind}.{n}.unit": entry.unit for n, entry in getattr(table, kind).items()}
    for kind in ("states", "coordinates"):
        entries = table.model.get(kind)
        if isinstance(entries, Mapping):
            units |= {f"model.{kind}.{name}": unit for name, unit in entries.items()}
    parameters = table.model.get("parameters")
    if isinstance(parameters, Mapping):
        units |= {
            f"model.parameters.{name}.unit": entry.get("unit")
            for name, entry in parameters.items()
            if isinstance(entry, Mapping)
        }
    for where, unit in units.items():
        if isinstance(unit, str):
            with at(where):
                check_unit(unit)


def _check_columns(of: tuple[Signal, ...], columns: Mapping[str, ColumnTable], kind: str) -> None:
    check_known(of, columns, kind=kind, where=f"recording.{kind}s")
    for signal in of:
        if signal.name not in columns:
            hint = nearest(signal.name, columns)
            raise ProblemError(
                f"recording.{kind}s: there is no column for the model's {kind} '{signal.name}', "
                f"{hint}"
            )


def check_known(
    of: Sequence[Signal], columns: Mapping[str, ColumnTable], *, kind: str, where: str
) -> None:
    """Raise `ProblemError` if a column's signal is unknown or has another unit in the model."""
    known = {s.name: s.unit for s in of}
    for name, column in columns.items():
        if name not in known:
            hint = nearest(name, known)
            raise ProblemError(f"{where}.{name}: the model has no {kind} '{name}', {hint}")
        if column.unit and known[name] and not convertible(column.unit, known[name]):
            raise ProblemError(
                f"{where}.{name}.unit: the model takes '{name}' in {known[name]}, to which "
                f"{column.unit} cannot be converted; give the factor from the file's unit to "
                f"{known[name]}"
            )


def _described(
    group: tuple[Signal, ...], entries: Mapping[str, EstimateTable]
) -> tuple[Signal, ...]:
    return tuple(_signal(s, entries[s.name]) if s.name in entries else s for s in group)


def _signal(signal: Signal, entry: EstimateTable) -> Signal:
    return dataclasses.replace(
        signal,
        value=entry.start,
        unit=signal.unit if entry.unit is None else entry.unit,
        lower=signal.lower if entry.lower is None else entry.lower,
        upper=signal.upper if entry.upper is None else entry.upper,
        scale=signal.scale if entry.scale is None else entry.scale,
        positive=entry.positive or signal.positive,
    )
