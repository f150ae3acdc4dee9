"""Loops that advance a large part of the memory where it is."""

import dataclasses
from collections.abc import Iterable, Iterator

from backsight.engine.program._coalesce import renamed
from backsight.engine.program.program import (
    Copy,
    Loop,
    Program,
    Slice,
    Statement,
    Table,
    While,
    operands,
)

LARGE = 64
"""Numbers; a smaller part is faster as a local variable."""


def in_place(program: Program) -> Program:
    """Return a program that does the same without copies of memory that a loop may leave alone.

    The memory of a loop starts as a copy of a part of that of the program, and is copied back at
    the end. If nobody looks at that part meanwhile, the loop works on it where it is: a loop that
    makes no pass, since nothing has changed, then costs nothing, however large its memory.
    """
    for k, statement in enumerate(program.body):
        if isinstance(statement, Copy) and _may_stay(program, k, statement):
            place, buffer = statement.source, statement.target.buffer
            body = (*program.body[:k], *program.body[k + 1 :])
            moved = tuple(renamed(s, buffer, place) for s in body)
            update = tuple(c for c in program.update if c.source.buffer != buffer)
            return in_place(dataclasses.replace(program, body=moved, update=update))
    return program


def _may_stay(program: Program, k: int, start: Copy) -> bool:
    """Whether the copy at the start of a loop and that at the end can be left out."""
    place, buffer = start.source, start.target.buffer
    if place.buffer != program.carry or start.target != buffer.whole() or buffer.size < LARGE:
        return False
    back = Copy(buffer.whole(), place)
    others = [copy for copy in program.update if copy != back]
    if back not in program.update or any(s.buffer == buffer for s, _ in _reached(others)):
        return False
    if any(s.buffer == buffer for s, _ in _reached(program.body[:k])):
        return False
    around = _reached([*program.body[k + 1 :], *others])
    return not any(
        s.buffer == place.buffer
        and s.offset < place.offset + place.size
        and place.offset < s.offset + reach
        for s, reach in around
    )


def _reached(
    statements: Iterable[Statement], lengths: dict[str, int] | None = None
) -> Iterator[tuple[Slice, int]]:
    """Slices that statements name, and how far from its offset each comes in all passes."""
    lengths = lengths or {}
    for statement in statements:
        for place in operands(statement):
            moves = (_farthest(stride, lengths[counter]) for counter, stride in place.strides)
            yield place, place.size + sum(moves)
        match statement:
            case Loop(counter, length, body):
                yield from _reached(body, {**lengths, counter: length})
            case While(body=body, update=update):
                yield from _reached((*body, *update), lengths)


def _farthest(stride: int | Table, length: int) -> int:
    return max(stride.values) if isinstance(stride, Table) else stride * (length - 1)
