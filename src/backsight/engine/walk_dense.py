"""Operations on large matrices as loops over very small leaves."""

import itertools
from collections.abc import Sequence

import casadi as ca

from backsight.engine.dense import Dense
from backsight.engine.program import Call, Copy, Loop, Slice, Statement
from backsight.engine.scope import Scope
from backsight.errors import EngineError

TERMS = 8
"""Columns that are added in one pass over a column of the result."""


def write_dense(
    operation: Dense, arguments: Sequence[Slice], scope: Scope
) -> tuple[list[Statement], list[list[Slice]]]:
    """Statements and results of a function of `backsight.engine.dense`.

    Raises
    ------
    EngineError
        If the operation is not known.
    """
    m, n = operation.rows, operation.columns
    if operation.kind == "product" and operation.pattern is not None:
        return _product(operation.pattern, m, arguments, scope)
    result = scope.buffer(operation.kind, m * n).whole()
    row, column = scope.name("row"), scope.name("column")
    there = arguments[0].part(0, 1).moving(column, m).moving(row, 1)
    mirrored = result.part(0, 1).moving(column, 1).moving(row, n)
    if operation.kind == "transpose":
        inner: Statement = Copy(there, mirrored)
    elif operation.kind == "symmetrise":
        across = arguments[0].part(0, 1).moving(column, 1).moving(row, n)
        inner = Call(scope.leaf(_MEAN), (there, across), (mirrored,))
    else:
        raise EngineError(f"'{scope.recursion}' uses the unknown operation '{operation.kind}'")
    return [Loop(row, m, (Loop(column, n, (inner,)),))], [[result]]


def _product(
    pattern: ca.Sparsity, m: int, arguments: Sequence[Slice], scope: Scope
) -> tuple[list[Statement], list[list[Slice]]]:
    """C + A F': to every column of C, columns of A times the entries of a row of F."""
    C, A, F = arguments
    result = scope.buffer("product", C.size).whole()
    rows = sorted(zip(pattern.row(), pattern.get_col(), range(pattern.nnz()), strict=True))
    entries = {r: list(group) for r, group in itertools.groupby(rows, lambda entry: entry[0])}
    statements: list[Statement] = []
    for r in range(pattern.shape[0]):
        column, before = result.part(r * m, 1), C.part(r * m, 1)
        present = entries.get(r, [])
        if not present:
            statements.append(Copy(C.part(r * m, m), result.part(r * m, m)))
        for start in range(0, len(present), TERMS):
            counter = scope.name("k")
            terms = present[start : start + TERMS]
            columns = [A.part(c * m, 1).moving(counter, 1) for _, c, _ in terms]
            factors = [F.part(k, 1) for _, _, k in terms]
            operands = (before.moving(counter, 1), *columns, *factors)
            leaf = scope.leaf(_SUMS[len(terms)])
            statements.append(
                Loop(counter, m, (Call(leaf, operands, (column.moving(counter, 1),)),))
            )
            before = column
    return statements, [[result]]


def _sum_of(n: int) -> ca.Function:
    c, a, f = ca.SX.sym("c"), ca.SX.sym("a", n), ca.SX.sym("f", n)
    arguments = [c, *ca.vertsplit(a), *ca.vertsplit(f)]
    return ca.Function(f"add_{n}_products", arguments, [c + ca.dot(a, f)])


_SUMS = {n: _sum_of(n) for n in range(1, TERMS + 1)}
_A, _B = ca.SX.sym("a"), ca.SX.sym("b")
_MEAN = ca.Function("mean", [_A, _B], [(_A + _B) / 2])
