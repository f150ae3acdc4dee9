"""Operations that only move numbers, as slices of what they move: nothing is copied for them."""

import itertools

import casadi as ca
import numpy as np

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
    at = np.asarray(places)
    begins = np.concatenate([[0], np.flatnonzero(np.diff(at) != 1) + 1])
    firsts, sizes = at[begins], np.diff(np.append(begins, len(at)))
    if len(begins) <= most:
        runs = zip(firsts.tolist(), sizes.tolist(), strict=True)
        return [], [[value.part(first, size) for first, size in runs]]
    strides = np.diff(firsts)
    even = strides.size and (sizes == sizes[0]).all() and (strides == strides[0]).all()
    if even and strides[0] >= 1:
        first = value.part(places[0], int(sizes[0]))
        return _copied(first, int(strides[0]), len(begins), scope)
    if value.size < MANY:
        return None
    return _copied(value.part(0, 1), scope.table("taken_from", tuple(places)), len(places), scope)


def _copied(first: Slice, stride: int | Table, count: int, scope: Scope) -> Regrouped:
    """Pieces of equal size, one after the other."""
    counter, result = scope.name("k"), scope.buffer("taken", first.size * count).whole()
    target = result.part(0, first.size).moving(counter, first.size)
    return [Loop(counter, count, (Copy(first.moving(counter, stride), target),))], [[result]]
