"""Remove copies from a loop program by letting values arise where they are wanted."""

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence

from backsight.engine.program.program import (
    Buffer,
    Call,
    Copy,
    Foreign,
    Loop,
    Program,
    Slice,
    Statement,
    While,
    flat,
    operands,
    reads,
)

Block = tuple[Statement, ...]


def without_copies(program: Program) -> Program:
    """Return a program that does the same with fewer copies.

    Where a buffer is only filled in order to be copied to another place, and nobody looks at that
    place meanwhile, the two become one. So a loop's memory is advanced in place, and results are
    written to the caller's memory at once. Copies of `While.update` and `Program.update` stay,
    since with several lanes they only happen in some.
    """
    lasting = {b.name for b in program.interface}
    while True:
        uses = Counter[str]()
        for statement in (*program.body, *program.update):
            uses.update(statement.uses)
        body = _shorter(program.body, {b: n for b, n in uses.items() if b not in lasting})
        if body is None:
            return program
        program = dataclasses.replace(program, body=body)


def _shorter(block: Block, uses: dict[str, int]) -> Block | None:
    """The block with one copy less, or None if none can be spared."""
    for k, statement in enumerate(block):
        if isinstance(statement, Copy):
            first = _first_use(block, k, statement, uses)
            if first is not None:
                source, target = statement.source.buffer, statement.target
                moved = (renamed(s, source, target) for s in block[first:k])
                kept = (s for s in moved if not (isinstance(s, Copy) and s.source == s.target))
                return (*block[:first], *kept, *block[k + 1 :])
        elif isinstance(statement, Loop | While):
            body = _shorter(statement.body, uses)
            if body is not None:
                inner = dataclasses.replace(statement, body=body)
                return (*block[:k], inner, *block[k + 1 :])
    return None


def _first_use(block: Block, k: int, copy: Copy, uses: dict[str, int]) -> int | None:
    """Where the copied buffer is first used, if it may be replaced by the copy's target."""
    buffer, name = copy.source.buffer, copy.source.buffer.name
    if buffer.values is not None or name not in uses or copy.source != buffer.whole():
        return None
    inside = [x.uses.get(name, 0) for x in block[: k + 1]]
    if sum(inside) != uses[name]:
        return None
    first = next(i for i, count in enumerate(inside) if count)
    start = block[first]
    # The first statement must fill the buffer; it may read the target if it reads first.
    if isinstance(start, Loop | While) or any(s.buffer == buffer for s in reads(start)):
        return None
    if isinstance(start, Foreign) and any(copy.target.overlaps(s) for s in reads(start)):
        return None
    if copy.target.buffer.name not in uses and sum(inside) > 2:
        return None  # memory of the caller is slower than a local variable
    source = start.source if isinstance(start, Copy) else None
    if source is not None and source != copy.target and source.overlaps(copy.target):
        return None  # within one buffer a copy must not move numbers up
    touched = [s for x in block[first + 1 : k] for s in _all(x)]
    touched += [s for s in operands(start) if s not in reads(start)]
    return None if any(copy.target.overlaps(s) for s in touched) else first


def _all(statement: Statement) -> Iterator[Slice]:
    return (s for x in flat([statement]) for s in operands(x))


def renamed(statement: Statement, old: Buffer, new: Slice) -> Statement:
    """The statement with a slice in the place of a buffer."""

    def slice_(s: Slice) -> Slice:
        if s.buffer != old:
            return s
        moved = (*new.strides, *s.strides)
        return Slice(new.buffer, new.offset + s.offset, s.size, moved)

    def slices(group: Sequence[Slice]) -> tuple[Slice, ...]:
        return tuple(slice_(s) for s in group)

    match statement:
        case Call(leaf, inputs, outputs):
            return Call(leaf, slices(inputs), slices(outputs))
        case Foreign(inputs=inputs, outputs=outputs):
            return dataclasses.replace(statement, inputs=slices(inputs), outputs=slices(outputs))
        case Copy(source, target):
            return Copy(slice_(source), slice_(target))
        case Loop(counter, length, body):
            return Loop(counter, length, tuple(renamed(s, old, new) for s in body))
        case While(flag, limit, body, update):
            updates = (Copy(slice_(c.source), slice_(c.target)) for c in update)
            return While(
                slice_(flag), limit, tuple(renamed(s, old, new) for s in body), tuple(updates)
            )
