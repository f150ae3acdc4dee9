"""Structures whose stiffness or damping is not symmetric: complex modes, said and built."""

import warnings
from collections.abc import Mapping

import casadi as ca
import numpy as np
import scipy

from backsight.errors import BacksightWarning, ModelError
from backsight.models.model import Model
from backsight.models.structures.matrices._around import Around, feedthrough, with_ground
from backsight.models.structures.matrices._complex import complex_modes
from backsight.models.structures.matrices._motion import Moving, ground_shape
from backsight.models.structures.matrices._places import deflection
from backsight.models.structures.matrices._symmetric import Residual
from backsight.models.structures.modal import output_unit
from backsight.types import Array


def skew_model(
    structure: Moving,
    around: Around,
    modes: int,
    *,
    ratios: Array,
    residual: Residual,
    units: tuple[str, str],
    name: str,
) -> Model:
    """Build the model of the first complex modes; see `reduced`."""
    if residual == "modes":
        raise ModelError(
            f"{'; '.join(structure.whole.skew.values())}: for complex modes take "
            "residual = 'feedthrough'"
        )
    warnings.warn(
        f"{'; '.join(structure.whole.skew.values())}. Complex modes are kept, in real blocks",
        BacksightWarning,
        stacklevel=4,
    )
    T = structure.motions.T
    found = complex_modes(structure.mass, structure.damping, structure.stiffness, modes)
    S, out, into = found.damped(ratios).blocks()
    at_rest = scipy.sparse.linalg.splu(structure.stiffness).solve
    moved = {k: ground_shape(structure, at, at_rest) for k, at in around.ground.items()}
    forced = T.T @ around.loads().toarray()
    left = np.zeros_like(forced)
    if residual == "feedthrough":
        left = at_rest(forced) + out @ np.linalg.solve(S, into @ forced)
    B = dict(zip([*around.inputs, *around.forces], (into @ forced).T, strict=True))
    B |= {k: -into @ (T.T @ (structure.whole.mass @ iota)) for k, iota in moved.items()}
    outputs = _output_rows(around, S, T @ out, structure.whole.mass.diagonal())
    _check_moves(around, outputs, B)
    return _model(S, B, outputs, feedthrough(around, T @ left, moved), around, units, name)


def _output_rows(
    around: Around, S: Array, shapes: Array, mass: Array
) -> dict[str, tuple[Array, Array]]:
    """Of every output: its row of the states, and of their rates."""
    rows = {}
    for name, sensor in around.sensors.items():
        row = deflection(sensor.weights, shapes, mass)
        none = np.zeros_like(row)
        # w' is out S z since all modes together take no force into a rate of w; w'' = out S z'.
        rows[name] = {
            "displacement": (row, none),
            "strain": (row, none),
            "velocity": (row @ S, none),
            "acceleration": (none, row @ S),
        }[sensor.kind]
    return rows


def _check_moves(
    around: Around, outputs: Mapping[str, tuple[Array, Array]], B: Mapping[str, Array]
) -> None:
    for name, parts in outputs.items():
        if not any(part.any() for part in parts):
            raise ModelError(
                f"sensor '{name}' sees no mode: all its shapes are zero; move it, or take more "
                "modes"
            )
    for name, column in B.items():
        if not column.any():
            what = "force" if name in around.forces else "input"
            raise ModelError(
                f"{what} '{name}' moves no mode: all its shapes are zero; move it, or take more "
                "modes"
            )


def _model(
    S: Array,
    B: Mapping[str, Array],
    outputs: Mapping[str, tuple[Array, Array]],
    direct: Mapping[str, Mapping[str, float]],
    around: Around,
    units: tuple[str, str],
    name: str,
) -> Model:
    length, force = units
    inputs = [*around.inputs, *around.ground]
    x = ca.SX.sym("x", len(S))
    u, p = ca.SX.sym("u", len(inputs)), ca.SX.sym("p", len(around.forces))
    felt = dict(zip(inputs, ca.vertsplit(u), strict=True)) if inputs else {}
    felt |= dict(zip(around.forces, ca.vertsplit(p), strict=True)) if around.forces else {}
    rate = ca.mtimes(ca.sparsify(ca.DM(S)), x)
    for k, column in B.items():
        rate += ca.DM(column) * felt[k]
    rows = [
        ca.mtimes(ca.DM(of_x).T, x)
        + ca.mtimes(ca.DM(of_rate).T, rate)
        + sum(factor * felt[k] for k, factor in direct[output].items())
        for output, (of_x, of_rate) in outputs.items()
    ]
    made = Model(
        f=ca.Function("f", [x, u, p], [rate]),
        h=ca.Function("h", [x, u, p], [ca.vertcat(*rows)]),
        states=dict.fromkeys(_states(S), ""),
        inputs=dict.fromkeys(inputs, force),
        outputs={k: output_unit(s.kind, length) for k, s in around.sensors.items()},
        parameters=dict.fromkeys(around.forces, (0.0, force)),
        name=name,
    )
    return with_ground(made, around, length)


def _states(S: Array) -> list[str]:
    """Names of the states: ``z1_re, z1_im`` of a pair, ``z2`` of a mode that does not swing."""
    names, i = [], 0
    while i < len(S):
        k = len({name.partition("_")[0] for name in names}) + 1
        pair = i + 1 < len(S) and S[i, i + 1] != 0
        names += [f"z{k}_re", f"z{k}_im"] if pair else [f"z{k}"]
        i += 2 if pair else 1
    return names
