"""A matrix with some of its rows swept, and functions of numbers for all of its rows.

The rows of a problem lie side by side in a row vector. What is done with every one of them is a
small function of numbers in a loop: that is faster than one large function of all.
"""

import casadi as ca
import numpy as np

from backsight.engine.dense import add_product
from backsight.engine.loops import scan

NEVER = 1e300
"""Length of a step that nothing ends."""


def each(leaf: ca.Function, rows: list[ca.MX], *constants: ca.MX) -> list[ca.MX]:
    """Results of a function of numbers for every row of the problem."""
    return scan(leaf, rows[0].shape[1], carry=[], xs=rows, constants=constants)[1]


def gather(
    leaf: ca.Function, start: list[float], rows: list[ca.MX], *constants: ca.MX
) -> list[ca.MX]:
    """What a function of numbers has found after all rows of the problem; they are numbered."""
    n = rows[0].shape[1]
    carry = [ca.MX(value) for value in start]
    return scan(leaf, n, carry=carry, xs=[numbers(n), *rows], constants=constants)[0]


def numbers(n: int) -> ca.MX:
    """0 ... n - 1 as a row."""
    return ca.MX(ca.DM(range(n)).T)


def symbols(names: str) -> list[ca.SX]:
    """Numbers with the names in a text."""
    return [ca.SX.sym(name) for name in names.split()]


def times(T: ca.MX, row: ca.MX) -> ca.MX:
    """Symmetric T times a row."""
    return add_product(ca.MX.zeros(T.shape[0], 1), T, row).T


def unit_row(n: int, number: ca.MX) -> ca.MX:
    """Row vector that is 1 at a number, 0 if that is -1."""
    k, wanted = symbols("k wanted")
    leaf = ca.Function("unit_row", [k, wanted], [ca.if_else(k == wanted, 1, 0)])
    return each(leaf, [numbers(n)], number)[0]


def sweep(T: ca.MX, number: ca.MX, direction: ca.MX, least: float) -> tuple[ca.MX, ca.MX]:
    r"""Make a row active (direction 1) or inactive (-1): the new T, and 1 if there was room.

    T is M with its active rows A swept, and 2 more on their diagonal:
    :math:`T_{AA} = 2 I - M_{AA}^{-1}`, :math:`T_{IA} = M_{IA} M_{AA}^{-1}`,
    :math:`T_{II} = M_{II} - M_{IA} M_{AA}^{-1} M_{AI}`. With the unit vector e of the row,
    :math:`v = T e - e` and :math:`d = e' v \pm 1` the change is :math:`-v v' / d` both ways.
    With the number -1 nothing changes.
    """
    pivot = unit_row(T.shape[0], number)
    v = add_product(-pivot.T, T, pivot).T
    (entry,) = gather(_entry(), [0.0], [v], number)
    factor, room = _pivot(least)(entry, number, direction)
    left = each(_scale(), [v], factor)[0]
    return add_product(T, left.T, v.T), room


def _entry() -> ca.Function:
    so_far, k, value, number = symbols("so_far k value number")
    results = [so_far + ca.if_else(k == number, value, 0)]
    return ca.Function("entry", [so_far, k, value, number], results)


def _pivot(least: float) -> ca.Function:
    entry, number, direction = symbols("entry number direction")
    d = entry + direction
    room = ca.logic_and(number >= 0, ca.logic_or(direction < 0, d > least))
    factor = ca.if_else(room, -1 / ca.if_else(room, d, 1), 0)
    return ca.Function("pivot", [entry, number, direction], [factor, room])


def _scale() -> ca.Function:
    a, b = symbols("a b")
    return ca.Function("scale_row", [a, b], [a * b])


def inverse(T: ca.MX, weight: ca.MX) -> ca.MX:
    """diag(weight) M_A^-1 diag(weight) from the swept M, see `sweep`, column by column."""
    n = weight.numel()
    own, factor, column, of_rows = (
        ca.SX.sym(v, m) for v, m in zip("ofcr", (n, 1, T.shape[0], n), strict=True)
    )
    result = factor * of_rows * (own - column[:n])
    body = ca.Function("inverse_column", [own, column, factor, of_rows], [result])
    xs = [ca.MX(2 * np.eye(n)), T[:, :n], weight]
    return scan(body, n, carry=[], xs=xs, constants=[weight.T])[1][0]
