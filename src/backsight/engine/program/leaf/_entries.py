"""The same for each of many numbers: results of a leaf that are better made in a loop.

Straight-line code for hundreds of numbers takes longer to compile than all the rest of a program.
"""

import dataclasses
from collections.abc import Sequence
from typing import TypeAlias

from backsight.engine.program.leaf._leaf import Leaf, Operation, without_unused

MANY = 24
"""So many results that are made alike become a loop."""

DEEP = 48
"""Operations for one number, up to which that is looked for."""


SHARED = -2
"""In the place of an argument: the last result of the leaf that is left."""


@dataclasses.dataclass(frozen=True)
class Operand:
    """What the operations of a number take.

    Parameters
    ----------
    argument, number : int
        Of the leaf, for its first number; `SHARED` is what is computed once for all numbers.
    stride : int
        From one number to the next.
    values : tuple of float
        Of a constant, which is no argument.
    """

    argument: int
    number: int
    stride: int
    values: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class Repeated:
    """A result of which every number is made like the first one.

    Parameters
    ----------
    output : int
        Of the leaf.
    leaf : Leaf
        For one number.
    operands : tuple of Operand
        Its inputs.
    """

    output: int
    leaf: Leaf
    operands: tuple[Operand, ...]


def entries_of(leaf: Leaf) -> tuple[list[Repeated], Leaf]:
    """Results that loops can make, and the leaf without them.

    Alike are numbers with the same operations whose operands are the same for all, or lie one
    behind the other, or are constants. What is computed once for all of them is one more result of
    the leaf that is left.
    """
    found: list[Repeated] = []
    left, shared = list(leaf.outputs), list[int]()
    for j, output in enumerate(leaf.outputs):
        if len(output) >= MANY and (one := _alike(leaf, j, shared)):
            found.append(one)
            left[j] = ()
    if not found:
        return [], leaf
    names = (*leaf.names, "shared")
    whole = dataclasses.replace(leaf, outputs=(*left, tuple(shared)), names=names)
    return found, without_unused(whole)


_Tree: TypeAlias = list[tuple[Operation, tuple[int, ...]]]
"""Operations with their arguments as places in the list; the last one is the number."""


def _alike(leaf: Leaf, j: int, shared: list[int]) -> Repeated | None:
    """Result j as the same operations for each number, None if they differ; adds what is shared."""
    numbers = leaf.outputs[j]
    common = _reached(leaf, numbers[0]) & _reached(leaf, numbers[1]) & _reached(leaf, numbers[-1])
    first = _tree(leaf, numbers[0], common)
    if not first or all(o.kind in ("input", "const", "shared") for o, _ in first):
        return None  # only moved: no operation
    trees = [first]
    for k in numbers[1:]:
        trees.append(_tree(leaf, k, common))
        if [(o.kind, a) for o, a in trees[-1]] != [(o.kind, a) for o, a in first]:
            return None
    operations: list[Operation] = []
    operands: list[Operand] = []
    computed: list[int] = []
    for place, (operation, arguments) in enumerate(first):
        column = [tree[place][0] for tree in trees]
        if operation.kind not in ("input", "const", "shared"):
            operations.append(Operation(operation.kind, arguments, operation.value))
            continue
        operand = _taken(column)
        if operand is None:
            return None
        if operation.kind == "const" and len({value.hex() for value in operand.values}) == 1:
            operations.append(operation)
            continue
        if operation.kind == "shared":
            computed.append(operand.number)
            operand = Operand(SHARED, len(shared) + len(computed) - 1, 0)
        operations.append(Operation("input", (len(operands), 0)))
        operands.append(operand)
    shared += computed
    names = *(f"i{k}" for k in range(len(operands))), "o0"
    ones = (1,) * len(operands)
    one = Leaf(f"{leaf.name}_each", ones, tuple(operations), ((len(operations) - 1,),), names)
    return Repeated(j, one, tuple(operands))


def _reached(leaf: Leaf, k: int) -> set[int]:
    """Operations, beside arguments and constants, on which a number depends."""
    reached, new = set[int](), [k]
    while new:
        at = new.pop()
        operation = leaf.operations[at]
        if at not in reached and operation.kind not in ("input", "const"):
            reached.add(at)
            new += operation.arguments
    return reached


def _taken(column: Sequence[Operation]) -> Operand | None:
    """What one operation of every number takes, None if that has no order."""
    if column[0].kind == "const":
        return Operand(-1, 0, 0, tuple(o.value for o in column))
    argument, number = column[0].arguments
    stride = column[1].arguments[1] - number
    wanted = [(argument, number + stride * i) for i in range(len(column))]
    if stride < 0 or [o.arguments for o in column] != wanted:
        return None
    return Operand(argument, number, stride)


def _tree(leaf: Leaf, k: int, common: set[int]) -> _Tree:
    """What a number is made of, beside what is common to all; nothing if that is too much."""
    tree: _Tree = []
    places: dict[int, int] = {}
    todo = [k]
    while todo:
        operation = leaf.operations[todo[-1]]
        if todo[-1] in common:
            operation = Operation("shared", (SHARED, todo[-1]))
        needed = () if operation.kind in ("input", "shared") else operation.arguments
        missing = [a for a in needed if a not in places]
        if missing:
            todo += reversed(missing)
        elif (at := todo.pop()) not in places:
            places[at] = len(tree)
            tree.append((operation, tuple(places[a] for a in needed)))
        if len(tree) > DEEP or len(todo) > DEEP:
            return []
    return tree
