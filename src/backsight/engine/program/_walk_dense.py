"""Operations on large matrices as loops over very small leaves."""

from collections.abc import Sequence

import casadi as ca

from backsight.engine.dense import Dense
from backsight.engine.program._scope import Scope
from backsight.engine.program.program import Call, Copy, Loop, Slice, Statement, Table
from backsight.errors import EngineError


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
    """C + A F': for every entry of F a column of A is added to a column of the result."""
    C, A, F = arguments
    result = scope.buffer("product", C.size).whole()
    start = Copy(C, result)
    if not pattern.nnz():
        return [start], [[result]]
    entry, row = scope.name("entry"), scope.name("row")
    whereto = Table(scope.name("whereto"), tuple(m * r for r in pattern.row()))
    whence = Table(scope.name("whence"), tuple(m * c for c in pattern.get_col()))
    total = result.part(0, 1).moving(entry, whereto).moving(row, 1)
    term = A.part(0, 1).moving(entry, whence).moving(row, 1)
    add = Call(scope.leaf(_ADD), (total, term, F.part(0, 1).moving(entry, 1)), (total,))
    return [start, Loop(entry, pattern.nnz(), (Loop(row, m, (add,)),))], [[result]]


_A, _B = ca.SX.sym("a"), ca.SX.sym("b")
_C = ca.SX.sym("c")
_ADD = ca.Function("add_product", [_C, _A, _B], [_C + _A * _B])
_MEAN = ca.Function("mean", [_A, _B], [(_A + _B) / 2])
