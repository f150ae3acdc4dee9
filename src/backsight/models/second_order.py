"""Vibrating structures from mass, damping and stiffness matrices (eq. 1-7).

Source: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen (2012), "Moving horizon observer for vibration
dynamics with plant uncertainties in nanopositioning system estimation", ACC 2012.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from backsight.errors import ModelError, nearest
from backsight.models.expressions import expressions, symbol_table
from backsight.models.model import Model
from backsight.models.signals import Named, Signal, signals

Entries: TypeAlias = ArrayLike | Sequence[Sequence[float | str]] | str
"""A matrix whose entries are numbers or formulas of the parameters."""

Direction: TypeAlias = str | Sequence[float | str] | ArrayLike
"""A coordinate, or one entry per coordinate."""

_KINDS = ("displacement", "velocity", "acceleration")


def second_order(
    mass: Entries,
    damping: Entries,
    stiffness: Entries,
    *,
    forces: Mapping[str, Direction],
    outputs: Mapping[str, tuple[str, Direction]],
    inputs: Mapping[str, object] | Sequence[Signal] = (),
    parameters: Mapping[str, object] | Sequence[Signal] = (),
    coordinates: Mapping[str, object] | Sequence[Signal] | None = None,
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
    size = np.atleast_2d(np.asarray(mass, dtype=object)).shape[0]
    q_signals = signals(coordinates or {f"q{i + 1}": "" for i in range(size)}, "coordinate")
    names = [s.name for s in q_signals]
    groups = (
        (*q_signals, *map(_velocity, q_signals)),
        signals(inputs, "input"),
        signals(parameters, "parameter"),
    )
    x, u, p = (ca.SX.sym(k, len(group)) for k, group in zip(("x", "u", "p"), groups, strict=True))
