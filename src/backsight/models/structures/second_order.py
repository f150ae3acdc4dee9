"""Vibrating structures from mass, damping and stiffness matrices (eq. 1-7).

Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer for vibration
dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.
"""

import sys
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from backsight.algebra.expressions import check_names, expressions
from backsight.errors import ModelError, nearest
from backsight.models.lti import remember_slopes
from backsight.models.model import Model, Signals
from backsight.models.signals import Signal, Virtual, signals

Entries: TypeAlias = ArrayLike | Sequence[Sequence[float | str]] | str
"""A matrix whose entries are numbers or formulas of the parameters."""

Direction: TypeAlias = str | Sequence[float | str] | ArrayLike
"""A coordinate, or one entry per coordinate."""

Motion: TypeAlias = Literal["displacement", "velocity", "acceleration"]
"""What an output measures."""

_UNIT_ENDS: dict[Motion, str] = {"displacement": "", "velocity": "/s", "acceleration": "/s2"}


def second_order(
    mass: Entries,
    damping: Entries,
    stiffness: Entries,
    *,
    forces: Mapping[str, Direction],
    outputs: Mapping[str, tuple[Motion, Direction]],
    inputs: Signals = (),
    parameters: Signals = (),
    coordinates: Signals | None = None,
    virtual: Mapping[str, tuple[Motion, Direction]] | None = None,
    name: str = "structure",
) -> Model:
    r"""Build a structure of any number of degrees of freedom (eq. 1-2).

    .. math:: M \ddot q + C \dot q + K q = \sum_i l_i f_i

    with the forces :math:`f_i` as text and their directions :math:`l_i`, the columns of
    :math:`L_0`. Every entry of a matrix or direction is a number or a formula of the parameters,
    so that a stiffness, a damping or a mass can be estimated. A *known* force is an input times an
    actuator gain, ``"c*V"``; an *unknown* force is a parameter with the value 0. `augment` makes
    states of both.

    Parameters
    ----------
    mass, damping, stiffness : (n, n) array of numbers and formulas
        The matrices, in units that fit the coordinates and forces. The mass matrix is symmetric and
        positive definite; zero stiffness (a free body) is allowed. A single number or formula will
        do for one degree of freedom.
    forces : dict
        Force, as a formula of the inputs and parameters, to where it acts: the name of a
        coordinate, or the direction with one entry per coordinate. A formula may also use the
        states: ``{"-k3*q1**3": "q1"}`` is a cubic spring.
    outputs : dict
        Name to ``(kind, where)``: the kind is "displacement", "velocity" or "acceleration"; where
        is a coordinate or one weight per coordinate. Accelerations contain the forces directly.
    inputs, parameters : dict
        Name to unit, value, ``(value, unit)`` or `Signal`.
    coordinates : dict, optional
        Name of every degree of freedom to its unit; "q1", "q2"... if not given. The velocity of
        "q1" is the state "q1_dot".
    virtual : dict, optional
        Motions that no sensor measures, described like `outputs`: see `with_virtual`, which takes
        formulas of them, too.
    name : str
        Shown in results.

    Returns
    -------
    Model
        States :math:`[q, \dot q]`.

    Raises
    ------
    ModelError
        If a size or a name is wrong, a formula cannot be read, or the mass matrix is not symmetric
        positive definite at the values of the parameters.

    Examples
    --------
    Two masses in a row, a piezo with unknown gain at the first, an unknown force at the second:

    >>> row = second_order(
    ...     mass=[["m1", 0], [0, "m2"]],
    ...     damping=[[0.3, -0.1], [-0.1, 0.1]],
    ...     stiffness=[["k1 + k2", "-k2"], ["-k2", "k2"]],
    ...     forces={"c*V": "q1", "w": "q2"},
    ...     inputs={"V": "V"},
    ...     parameters={"m1": 1.0, "m2": 2.0, "k1": 900.0, "k2": 400.0, "c": 5.0, "w": 0.0},
    ...     outputs={"y": ("displacement", "q1"), "a": ("acceleration", "q2")},
    ... )
    >>> print(row)
    structure (continuous)
    ├── states      q1, q2, q1_dot, q2_dot
    ├── inputs      V [V]
    ├── outputs     y, a
    └── parameters  m1 = 1, m2 = 2, k1 = 900, k2 = 400, c = 5, w = 0

    The stage of eq. 35, with everything unknown: ``second_order("m", "b", "k", forces={"c*u": "q1",
    "fu": "q1"}, ...)``. From a displacement alone only the ratios to the mass can be found; set
    ``m`` to 1 and the parameters are those of eq. 36 (`sdof`).
    """
    n = np.atleast_1d(np.asarray(mass, dtype=object)).shape[0]
    of_q = signals(
        {f"q{i + 1}": "" for i in range(n)} if coordinates is None else coordinates, "coordinate"
    )
    if len(of_q) != n:
        raise ModelError(f"{len(of_q)} coordinates are named, but the mass matrix has {n} rows")
    of_x = (*of_q, *map(_velocity, of_q))
    of_u, of_p = signals(inputs, "input"), signals(parameters, "parameter")
    x, u, p = ca.SX.sym("x", 2 * n), ca.SX.sym("u", len(of_u)), ca.SX.sym("p", len(of_p))
    names = [s.name for s in (*of_x, *of_u, *of_p)]
    check_names(names)
    symbols = dict(zip(names, ca.vertsplit(ca.vertcat(x, u, p)), strict=True))
    constants = {s.name: symbols[s.name] for s in of_p}

    M, C, K = (
        _entries(given, what, (n, n), constants)
        for given, what in ((mass, "mass"), (damping, "damping"), (stiffness, "stiffness"))
    )
    _check_mass(ca.Function("M", [p], [ca.densify(M)])([s.value for s in of_p]))
    # M = L D L' keeps the sparsity of M and serves numbers and symbols alike: no inverse.
    D, LT, permutation = ca.ldl(M)
    q, v = x[:n], x[n:]
    load = _load(forces, of_q, symbols) - ca.mtimes(C, v) - ca.mtimes(K, q)
    a = ca.ldl_solve(load, D, LT, permutation)

    motion = {"displacement": q, "velocity": v, "acceleration": a}
    w = ca.SX.sym("w", 2 * n)
    disturbed = motion | {"acceleration": a + w[n:]}
    z = [_output(k, given, disturbed, of_q, symbols) for k, given in (virtual or {}).items()]
    g = ca.Function("g", [x, u, p, w], [ca.densify(ca.vertcat(*z))])
    y = [_output(k, given, motion, of_q, symbols) for k, given in outputs.items()]
    f = ca.Function("f", [x, u, p], [ca.densify(ca.vertcat(v, a))])
    h = ca.Function("h", [x, u, p], [ca.densify(ca.vertcat(ca.SX(0, 1), *y))])
    plain = [where for _, where in outputs.values()]
    numeric = (mass, damping, stiffness, *forces.values(), *plain)
    if set(forces) <= {s.name for s in (*of_u, *of_p)} and all(map(_without_formulas, numeric)):
        for equation in (f, h):
            remember_slopes(equation, [s.value for s in of_p])
    return Model(
        f=f,
        h=h,
        states=of_x,
        inputs=of_u,
        outputs={k: _output_unit(kind, where, of_q) for k, (kind, where) in outputs.items()},
        parameters=of_p,
        name=name,
        virtual=Virtual(_virtual_signals(virtual, of_q), g) if virtual else None,
    )


def _without_formulas(given: Entries | Direction) -> bool:
    """Whether entries are numbers, or a direction the name of a coordinate."""
    if isinstance(given, str):
        return given.isidentifier()
    array = np.asarray(given, dtype=object)
    return array.ndim > 0 and not any(isinstance(entry, str) for entry in array.flat)


def _velocity(of_q: Signal) -> Signal:
    return Signal(name=f"{of_q.name}_dot", unit=f"{of_q.unit}/s" if of_q.unit else "")


def _entries(
    given: Entries | Direction, what: str, shape: tuple[int, ...], symbols: Mapping[str, ca.SX]
) -> ca.SX:
    array = np.asarray(given, dtype=object)
    if array.ndim == 0 and shape == (1, 1):
        array = array.reshape(shape)
    if array.shape != shape:
        raise ModelError(f"{what} has the shape {array.shape}; it must be {shape}")
    if isinstance(given, np.ndarray) and given.dtype == np.float64 and np.isfinite(given).all():
        return ca.SX(ca.sparsify(ca.DM(given)))
    texts = {_place(what, i): entry for i, entry in np.ndenumerate(array) if isinstance(entry, str)}
    read = expressions(texts, symbols)
    matrix = ca.SX.zeros(shape[0], shape[-1] if len(shape) == 2 else 1)
    for i, entry in np.ndenumerate(array):
        place = _place(what, i)
        if place in read:
            matrix[i] = read[place]
        elif (
            isinstance(entry, int | float | np.floating | np.integer)
            and abs(entry) <= sys.float_info.max
        ):
            matrix[i] = float(entry)
        else:
            raise ModelError(f"{place} is {entry!r}; it must be a finite number or a formula")
    return ca.sparsify(matrix)


def _place(what: str, index: tuple[int, ...]) -> str:
    parts = zip(("row", "column"), index, strict=False)
    return ", ".join([what, *(f"{part} {i + 1}" for part, i in parts)])


def _check_mass(M: ca.DM) -> None:
    values = np.array(M)
    if not np.isfinite(values).all():
        raise ModelError("mass is not finite at the values of the parameters")
    # Judged after scaling to a unit diagonal: masses and moments of inertia differ in size.
    root = np.sqrt(np.abs(values.diagonal()))
    size = np.outer(root, root)
    scaled = values / np.where(size > 0, size, 1.0)
    skew = np.abs(scaled - scaled.T)
    if skew.max() > 1e-9:
        row, column = np.unravel_index(skew.argmax(), skew.shape)
        raise ModelError(
            f"mass is not symmetric: row {row + 1}, column {column + 1} is "
            f"{values[row, column]:g}, its mirror image {values[column, row]:g}"
        )
    if not np.linalg.eigvalsh(scaled)[0] > len(values) * np.finfo(float).eps:
        raise ModelError(
            "mass is not positive definite: its smallest eigenvalue is "
            f"{np.linalg.eigvalsh(values)[0]:.3g}; every degree of freedom needs a mass"
        )


def _load(
    forces: Mapping[str, Direction], of_q: Sequence[Signal], symbols: Mapping[str, ca.SX]
) -> ca.SX:
    load = ca.SX.zeros(len(of_q))
    read = expressions({f"force '{text}'": text for text in forces}, symbols)
    for (what, force), where in zip(read.items(), forces.values(), strict=True):
        load += force * _direction(where, what, of_q, symbols)
    return load


def _direction(
    where: Direction, what: str, of_q: Sequence[Signal], symbols: Mapping[str, ca.SX]
) -> ca.SX:
    if not isinstance(where, str):
        return _entries(where, f"the direction of {what}", (len(of_q),), symbols)
    names = [s.name for s in of_q]
    if where not in names:
        raise ModelError(f"{what} is at the coordinate '{where}': {nearest(where, names)}")
    return ca.SX(ca.DM.eye(len(of_q)))[:, names.index(where)]


def _output(
    name: str,
    given: tuple[Motion, Direction],
    motion: Mapping[str, ca.SX],
    of_q: Sequence[Signal],
    symbols: Mapping[str, ca.SX],
) -> ca.SX:
    match given:
        case (str() as kind, where):
            pass
        case _:
            raise ModelError(f"output '{name}' is {given!r}; give (kind, where)")
    if kind not in motion:
        raise ModelError(f"output '{name}' is a '{kind}': {nearest(kind, motion)}")
    return ca.dot(_direction(where, f"output '{name}'", of_q, symbols), motion[kind])


def _virtual_signals(
    virtual: Mapping[str, tuple[Motion, Direction]], of_q: Sequence[Signal]
) -> tuple[Signal, ...]:
    units = {k: _output_unit(kind, where, of_q) for k, (kind, where) in virtual.items()}
    return tuple(Signal(name=k, unit=unit) for k, unit in units.items())


def _output_unit(kind: Motion, where: Direction, of_q: Sequence[Signal]) -> str:
    units = {s.unit for s in of_q if not isinstance(where, str) or s.name == where}
    unit = units.pop() if len(units) == 1 else ""
    return unit and unit + _UNIT_ENDS[kind]
