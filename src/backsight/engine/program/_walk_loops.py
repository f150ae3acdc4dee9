"""Loops over entries: of products with a matrix of few, and of results whose numbers are alike."""

from collections.abc import Sequence

import casadi as ca

from backsight.engine.dense import Product
from backsight.engine.program._scope import Scope
from backsight.engine.program.leaf import SHARED, Leaf
from backsight.engine.program.program import Call, Copy, Loop, Slice, Statement, Table


def write_product(
    product: Product, arguments: Sequence[Slice], scope: Scope
) -> tuple[list[Statement], list[list[Slice]]]:
    """C + A F', or C + A F: for every entry of F a column of A is added to one of the result."""
    C, A, F = arguments
    m, pattern = product.rows, product.pattern
    result = scope.buffer("product", C.size).whole()
    start = Copy(C, result)
    if not pattern.nnz():
        return [start], [[result]]
    entry, row = scope.name("entry"), scope.name("row")
    rows, columns = pattern.row(), pattern.get_col()
    to, of = (rows, columns) if product.turned else (columns, rows)
    whereto = Table(scope.name("whereto"), tuple(m * k for k in to))
    whence = Table(scope.name("whence"), tuple(m * k for k in of))
    total = result.part(0, 1).moving(entry, whereto).moving(row, 1)
    term = A.part(0, 1).moving(entry, whence).moving(row, 1)
    add = Call(scope.leaf(_ADD), (total, term, F.part(0, 1).moving(entry, 1)), (total,))
    return [start, Loop(entry, pattern.nnz(), (Loop(row, m, (add,)),))], [[result]]


_A, _B, _C = (ca.SX.sym(name) for name in "abc")
_ADD = ca.Function("add_product", [_C, _A, _B], [_C + _A * _B])


def write_entries(
    leaf: Leaf, arguments: Sequence[Slice], results: list[Slice], scope: Scope
) -> tuple[list[Statement], Leaf]:
    """Results of a leaf whose numbers are all made alike as loops, and the leaf to call before.

    It may have one more result than `results`, to which that is then added.
    """
    loops: list[Statement] = []
    entries, left = scope.entries(leaf)
    if len(left.outputs) > len(leaf.outputs):
        shared = scope.buffer(f"{leaf.name}_shared", len(left.outputs[-1])).whole()
        results.append(shared)
    for entry in entries:
        counter, target = scope.name("each"), results[entry.output]
        slices = []
        for operand in entry.operands:
            if operand.values:
                slices.append(scope.constant(operand.values).part(0, 1).moving(counter, 1))
                continue
            given = results[-1] if operand.argument == SHARED else arguments[operand.argument]
            place = given.part(operand.number, 1)
            slices.append(place.moving(counter, operand.stride) if operand.stride else place)
        call = Call(entry.leaf, tuple(slices), (target.part(0, 1).moving(counter, 1),))
        loops.append(Loop(counter, target.size, (call,)))
    return loops, left
