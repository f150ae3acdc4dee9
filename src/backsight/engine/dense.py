"""Operations on matrices that are too large to unroll.

Like a loop, each is a function whose *name* says what it is: the virtual machine runs its body,
other back ends recognise the name (`dense_of`) and write loops.
"""

import dataclasses
import re

import casadi as ca

UNROLL = 12
"""Up to this many rows straight-line code is faster."""

VECTOR = 4
"""Loops over a multiple of this many rows have no remainder, and are several times faster."""


@dataclasses.dataclass(frozen=True)
class Dense:
    """What a function of this module stands for.

    Parameters
    ----------
    kind : {"product", "transpose", "symmetrise"}
        ``C, A, F -> C + A F'``, ``A -> A'``, ``A -> (A + A') / 2``.
    rows, columns : int
        Of A.
    pattern : casadi.Sparsity, optional
        Of F, for a product.
    """

    kind: str
    rows: int
    columns: int
    pattern: ca.Sparsity | None = None


_NAME = re.compile(r"dense_(product|transpose|symmetrise)_(\d+)_(\d+)(?:_\d+_\d+)?")


def filled_up(rows: int) -> int:
    """Number of rows with those that are better added, as zeros, to a matrix in many products."""
    return -(-rows // VECTOR) * VECTOR


def add_product(C: ca.MX, A: ca.MX, F: ca.MX) -> ca.MX:
    """C + A F' for dense C (m, p) and A (m, n) and sparse F (p, n)."""
    (m, n), p = A.shape, F.shape[0]
    c, a, f = ca.MX.sym("C", m, p), ca.MX.sym("A", m, n), ca.MX.sym("F", F.sparsity())
    name = f"dense_product_{m}_{n}_{p}_{F.nnz()}"
    return ca.Function(name, [c, a, f], [c + a @ f.T])(ca.densify(C), ca.densify(A), F)


def transpose(A: ca.MX) -> ca.MX:
    """A' of a dense matrix."""
    a = ca.MX.sym("A", *A.shape)
    return ca.Function(f"dense_transpose_{A.shape[0]}_{A.shape[1]}", [a], [a.T])(A)


def symmetrise(A: ca.MX) -> ca.MX:
    """(A + A') / 2 of a dense square matrix."""
    a = ca.MX.sym("A", *A.shape)
    return ca.Function(f"dense_symmetrise_{A.shape[0]}_{A.shape[1]}", [a], [(a + a.T) / 2])(A)


def dense_of(function: ca.Function) -> Dense | None:
    """What operation a function stands for, or None if it is an ordinary function."""
    match = _NAME.fullmatch(function.name())
    if match is None:
        return None
    kind, rows, columns = match.group(1), int(match.group(2)), int(match.group(3))
    pattern = function.sparsity_in(2) if kind == "product" else None
    return Dense(kind, rows, columns, pattern)
