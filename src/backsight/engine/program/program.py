"""The loop program: what a back end reads to write code.

A program is a list of statements on named buffers of numbers. Leaves do all arithmetic; the
statements only say on which slices of which buffers, in which loops. Nothing here depends on the
language that is written, so LLVM and C come from the same program.
"""

import dataclasses
import functools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import TypeAlias

from backsight.engine.foreign import Kernel
from backsight.engine.program.leaf import Leaf
from backsight.errors import EngineError


@dataclasses.dataclass(frozen=True)
class Buffer:
    """A named row of numbers.

    Parameters
    ----------
    name : str
        Unique within the program.
    size : int
    values : tuple of float, optional
        Makes the buffer a constant. They do not tell it from others: that takes long of many.
    """

    name: str
    size: int
    values: tuple[float, ...] | None = dataclasses.field(default=None, compare=False)

    def whole(self) -> "Slice":
        """All of it."""
        return Slice(self, 0, self.size)


@dataclasses.dataclass(frozen=True)
class Table:
    """Whole numbers, one for each value of a counter."""

    name: str
    values: tuple[int, ...]


@dataclasses.dataclass(frozen=True)
class Slice:
    """Neighbouring numbers of a buffer, possibly moving with the counters of loops.

    Parameters
    ----------
    buffer : Buffer
    offset : int
        First number where all counters are 0.
    size : int
    strides : tuple of (str, int or Table)
        Counters of enclosing loops, and by how much the slice moves with each, or whereto.
    """

    buffer: Buffer
    offset: int
    size: int
    strides: tuple[tuple[str, int | Table], ...] = ()

    def __post_init__(self) -> None:
        if self.offset < 0 or self.offset + self.size > self.buffer.size:
            raise EngineError(f"'{self.buffer.name}' is used beyond its end")

    def part(self, offset: int, size: int) -> "Slice":
        """Return `size` numbers from `offset` on."""
        return dataclasses.replace(self, offset=self.offset + offset, size=size)

    @property
    def place(self) -> tuple[str, int, int, tuple[tuple[str, int | str], ...]]:
        """What tells it from other slices of a program, without the numbers of constants."""
        moves = ((c, s.name if isinstance(s, Table) else s) for c, s in self.strides)
        return self.buffer.name, self.offset, self.size, tuple(moves)

    def moving(self, counter: str, stride: int | Table) -> "Slice":
        """Return the slice that moves with a counter."""
        return dataclasses.replace(self, strides=(*self.strides, (counter, stride)))

    def overlaps(self, other: "Slice") -> bool:
        """Whether two slices may share a number."""
        if self.buffer != other.buffer:
            return False
        if self.strides or other.strides:
            return True
        return self.offset < other.offset + other.size and other.offset < self.offset + self.size


class _Naming:
    """What every statement knows of itself."""

    @functools.cached_property
    def uses(self: "Statement") -> Mapping[str, int]:  # type: ignore[misc]
        """How often the statement and those inside it name a buffer, by the buffer's name."""
        found = Counter(s.buffer.name for s in operands(self))
        for inner in inside(self):
            found.update(inner.uses)
        return found


@dataclasses.dataclass(frozen=True)
class Call(_Naming):
    """Apply a leaf: all inputs are read before an output is written."""

    leaf: Leaf
    inputs: tuple[Slice, ...]
    outputs: tuple[Slice, ...]

    def __post_init__(self) -> None:
        sizes = *self.leaf.inputs, *map(len, self.leaf.outputs)
        if tuple(s.size for s in (*self.inputs, *self.outputs)) != sizes:
            raise EngineError(f"'{self.leaf.name}' is called with slices of wrong sizes")


@dataclasses.dataclass(frozen=True)
class Foreign(_Naming):
    """Call a kernel; no output overlaps an input or another output.

    Parameters
    ----------
    kernel : Kernel
    inputs, outputs : tuple of Slice
    reals, ints : int
        Work space that the kernel needs meanwhile.
    """

    kernel: Kernel
    inputs: tuple[Slice, ...]
    outputs: tuple[Slice, ...]
    reals: int
    ints: int


@dataclasses.dataclass(frozen=True)
class Copy(_Naming):
    """Copy a slice to another of the same size, number after number.

    They may overlap if the target lies before the source.
    """

    source: Slice
    target: Slice

    def __post_init__(self) -> None:
        if self.source.size != self.target.size:
            raise EngineError(f"'{self.source.buffer.name}' is copied to another size")


@dataclasses.dataclass(frozen=True)
class Loop(_Naming):
    """Run the body for counter = 0 ... length - 1."""

    counter: str
    length: int
    body: tuple["Statement", ...]


@dataclasses.dataclass(frozen=True)
class While(_Naming):
    """Run body and then `update` while `flag` is not zero, at most `limit` times.

    With several lanes the body runs while any lane's flag is not zero, and `update` changes only
    the lanes whose flag was not zero; the body itself therefore writes nothing that outlives it.
    """

    flag: Slice
    limit: int
    body: tuple["Statement", ...]
    update: tuple[Copy, ...]


Statement: TypeAlias = Call | Foreign | Copy | Loop | While


@dataclasses.dataclass(frozen=True)
class Program:
    """One step of a recursion.

    Parameters
    ----------
    name : str
    carry : Buffer
        The memory, changed in place.
    inputs, outputs : tuple of Buffer
        Data and results of one sample.
    body : tuple of Statement
    update : tuple of Copy
        What becomes of the memory at the end of the step.
    """

    name: str
    carry: Buffer
    inputs: tuple[Buffer, ...]
    outputs: tuple[Buffer, ...]
    body: tuple[Statement, ...]
    update: tuple[Copy, ...]

    @property
    def interface(self) -> tuple[Buffer, ...]:
        """Buffers that belong to the caller."""
        return (self.carry, *self.inputs, *self.outputs)

    @property
    def leaves(self) -> tuple[Leaf, ...]:
        """Distinct leaves, in the order of their first call."""
        return tuple(dict.fromkeys(s.leaf for s in flat(self.body) if isinstance(s, Call)))

    @property
    def foreign(self) -> tuple[Foreign, ...]:
        """Calls of kernels, in their order."""
        return tuple(s for s in flat(self.body) if isinstance(s, Foreign))

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that are called."""
        return tuple(sorted({call.kernel.name for call in self.foreign}))

    @property
    def space(self) -> tuple[int, int]:
        """Numbers and ints in which all kernels can work, one after the other."""
        calls = self.foreign
        return max((c.reals for c in calls), default=0), max((c.ints for c in calls), default=0)

    @property
    def buffers(self) -> tuple[Buffer, ...]:
        """Constants and working memory, in the order of their first use."""
        used = (s.buffer for statement in self.statements for s in operands(statement))
        return tuple(dict.fromkeys(b for b in used if b not in self.interface))

    @property
    def tables(self) -> tuple[Table, ...]:
        """Tables by which slices move."""
        places = (s for statement in self.statements for s in operands(statement))
        steps = (step for place in places for _, step in place.strides)
        return tuple(dict.fromkeys(step for step in steps if isinstance(step, Table)))

    @property
    def statements(self) -> Iterator[Statement]:
        """Every statement, outer before inner."""
        return flat((*self.body, *self.update))


def flat(statements: Iterable[Statement]) -> Iterator[Statement]:
    """Every statement, outer before inner."""
    for statement in statements:
        yield statement
        yield from flat(inside(statement))


def inside(statement: Statement) -> tuple[Statement, ...]:
    """Statements that a loop runs."""
    match statement:
        case Loop(body=body):
            return body
        case While(body=body, update=update):
            return *body, *update
        case _:
            return ()


def operands(statement: Statement) -> tuple[Slice, ...]:
    """Slices that a statement itself names, without those inside it."""
    return (*reads(statement), *writes(statement))


def reads(statement: Statement) -> tuple[Slice, ...]:
    """Slices that a statement itself reads."""
    match statement:
        case Call(inputs=inputs) | Foreign(inputs=inputs):
            return inputs
        case Copy(source=source):
            return (source,)
        case While(flag=flag):
            return (flag,)
        case _:
            return ()


def writes(statement: Statement) -> tuple[Slice, ...]:
    """Slices that a statement itself writes."""
    match statement:
        case Call(outputs=outputs) | Foreign(outputs=outputs):
            return outputs
        case Copy(target=target):
            return (target,)
        case _:
            return ()
