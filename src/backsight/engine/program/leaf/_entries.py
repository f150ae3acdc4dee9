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


@dataclasses.dataclass(frozen=True)
class Operand:
    """What the operations of a number take.

    Parameters
    ----------
    argument, number : int
        Of the leaf, for its first number.
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
class Entry:
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


def entries_of(leaf: Leaf) -> tuple[list[Entry], Leaf]:
    """Results that loops can make, and the leaf without them.

    Alike are numbers with the same operations whose operands are the same for all, or lie one
    behind the other, or are constants.
    """
    found, left = [], list(leaf.outputs)
    for j, output in enumerate(leaf.outputs):
        if len(output) >= MANY and (one := _alike(leaf, j)):
            found.append(one)
            left[j] = ()
    if not found:
        return [], leaf
    return found, without_unused(dataclasses.replace(leaf, outputs=tuple(left)))


_Tree: TypeAlias = list[tuple[Operation, tuple[int, ...]]]
"""Operations with their arguments as places in the list; the last one is the number."""


def _alike(leaf: Leaf, j: int) -> Entry | None:
    """Result j as the same operations for each number, None if they differ."""
    numbers = leaf.outputs[j]
    first = _tree(leaf, numbers[0])
    if not first or all(o.kind in ("input", "const") for o, _ in first):
        return None  # only moved: no operation
    trees = [first]
    for k in numbers[1:]:
        trees.append(_tree(leaf, k))
        if [(o.kind, a) for o, a in trees[-1]] != [(o.kind, a) for o, a in first]:
            return None
    operations: list[Operation] = []
    operands: list[Operand] = []
    for place, (operation, arguments) in enumerate(first):
        column = [tree[place][0] for tree in trees]
        if operation.kind not in ("input", "const"):
            operations.append(Operation(operation.kind, arguments, operation.value))
            continue
        operand = _taken(column)
        if operand is None:
            return None
        if operation.kind == "const" and len({value.hex() for value in operand.values}) == 1:
            operations.append(operation)
            continue
        operations.append(Operation("input", (len(operands), 0)))
        operands.append(operand)
    names = *(f"i{k}" for k in range(len(operands))), "o0"
    ones = (1,) * len(operands)
    one = Leaf(f"{leaf.name}_each", ones, tuple(operations), ((len(operations) - 1,),), names)
    return Entry(j, one, tuple(operands))


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


def _tree(leaf: Leaf, k: int) -> _Tree:
    """What a number is made of; nothing if that is too much."""
    tree: _Tree = []
    places: dict[int, int] = {}
    todo = [k]
    while todo:
        operation = leaf.operations[todo[-1]]
        needed = () if operation.kind == "input" else operation.arguments
        missing = [a for a in needed if a not in places]
        if missing:
            todo += reversed(missing)
        elif (at := todo.pop()) not in places:
            places[at] = len(tree)
            tree.append((operation, tuple(places[a] for a in needed)))
        if len(tree) > DEEP or len(todo) > DEEP:
            return []
    return tree
