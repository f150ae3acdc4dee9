"""Operations that only move numbers, as slices of what they move: nothing is copied for them."""

import itertools

import casadi as ca

from backsight.engine.program._glue import positions
from backsight.engine.program._scope import Scope
from backsight.engine.program.program import Copy, Loop, Slice, Statement, Table

JOINING = {ca.OP_VERTCAT, ca.OP_HORZCAT, ca.OP_DIAGCAT}
SPLITTING = {ca.OP_VERTSPLIT, ca.OP_HORZSPLIT, ca.OP_DIAGSPLIT}

MANY = 256
"""From so many numbers on, a leaf that takes some of them in no order takes long to write."""

Regrouped = tuple[list[Statement], list[list[Slice]]]


def regroup(
    node: ca.MX, operation: int, values: list[Slice], scope: Scope, *, most: int
) -> Regrouped | None:
    """Statements and results of a node that only moves numbers.

    None of any other, or if a result would have more than `most` pieces of few numbers without any
    order.
    """
    # CasADi joins and splits only so that entries of the parts follow each other in memory.
    if operation in (ca.OP_RESHAPE, ca.OP_SPARSITY_CAST):
        return [], [[values[0]]]
    if operation in JOINING:
        pieces = [value for value in values if value.size]
        return ([], [pieces]) if 0 < len(pieces) <= most else None
    if operation in SPLITTING:
        ends = node.info()["offset"]
        return [], [[values[0].part(a, b - a)] for a, b in itertools.pairwise(ends)]
    if operation == ca.OP_GETNONZEROS:
        return _taken(positions(node), values[0], scope, most)
    return None


def _taken(places: list[int], value: Slice, scope: Scope, most: int) -> Regrouped | None:
    """Numbers at some places: as pieces, or in a loop."""
    if not places or min(places) < 0:
        return None
    runs = [[places[0], 0]]
    for place in places:
        if place != sum(runs[-1]):
            runs.append([place, 0])
        runs[-1][1] += 1
    if len(runs) <= most:
        return [], [[value.part(first, size) for first, size in runs]]
    sizes = {size for _, size in runs}
    strides = {b[0] - a[0] for a, b in itertools.pairwise(runs)}
    if len(sizes) == 1 and len(strides) == 1 and (stride := strides.pop()) >= 1:
        return _copied(value.part(places[0], sizes.pop()), stride, len(runs), scope)
    if value.size < MANY:
        return None
    return _copied(value.part(0, 1), scope.table("taken_from", tuple(places)), len(places), scope)


def _copied(first: Slice, stride: int | Table, count: int, scope: Scope) -> Regrouped:
    """Pieces of equal size, one after the other."""
    counter, result = scope.name("k"), scope.buffer("taken", first.size * count).whole()
    target = result.part(0, first.size).moving(counter, first.size)
    return [Loop(counter, count, (Copy(first.moving(counter, stride), target),))], [[result]]
