"""Long loops as functions: those of one kind are compiled once, however often a program has them.

The time of LLVM goes to loops, which it vectorises and unrolls, and programs of many states have
hundreds that differ only in the numbers they run over.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable

from backsight.engine.llvm._text import Text
from backsight.engine.llvm.width import Width
from backsight.engine.program import Call, Loop, Slice, Table

LEAST, LEAST_INSIDE = 4096, 65536
"""Passes of a loop, and of loops in loops, that are shared: of fewer the compiler makes more if it
knows their numbers."""

LARGEST_LEAF = 8
"""Operations in the body of such a loop."""

Move = tuple[int, int | None]
"""Which counter of a nest moves a slice, and by how much; None says that a table does."""


class SharedLoops:
    """The functions of a module.

    Parameters
    ----------
    width : Width
    """

    def __init__(self, width: Width) -> None:
        self._width = width
        self._names: dict[tuple[object, ...], str] = {}
        self.functions: list[str] = []
        """Their texts."""

    def write(self, loop: Loop, text: Text, address: Callable[[Slice], str]) -> bool:
        """Write a loop as a call, if it is long and simple; whether that was done.

        `address` writes the address of a slice that does not move with the loop.
        """
        found = _nest(loop)
        if found is None:
            return False
        counters, lengths, call = found
        slices = list(dict.fromkeys((*call.inputs, *call.outputs)))
        places, moves, tables = [], [], list[Table]()
        for s in slices:
            inside = [(c, step) for c, step in s.strides if c in counters]
            outside = tuple(k for k in s.strides if k[0] not in counters)
            places.append(dataclasses.replace(s, strides=outside))
            tables += [step for _, step in inside if isinstance(step, Table)]
            moves.append(
                tuple(
                    (counters.index(c), None if isinstance(step, Table) else step)
                    for c, step in inside
                )
            )
        alone = [sum(s.buffer == other.buffer for other in slices) == 1 for s in slices]
        order = [slices.index(s) for s in (*call.inputs, *call.outputs)]
        key = call.leaf.name, tuple(lengths[1:]), tuple(moves), tuple(alone), tuple(order)
        if key not in self._names:
            self._names[key] = f"@shared.{len(self._names)}"
            self.functions.append(self._function(*key))
        arguments = [f"i64 {lengths[0]}", *(f"ptr {address(place)}" for place in places)]
        arguments += [f"ptr @table.{table.name}" for table in tables]
        text.add(f"call void {self._names[key]}({', '.join(arguments)})")
        return True

    def _function(
        self,
        leaf: str,
        lengths: tuple[int, ...],
        moves: tuple[tuple[Move, ...], ...],
        alone: tuple[bool, ...],
        order: tuple[int, ...],
    ) -> str:
        text, number = Text(), itertools.count()
        counters = [f".k{k}" for k in range(len(lengths) + 1)]

        def index(move: tuple[Move, ...]) -> str:
            total = "0"
            for counter, step in move:
                at = f"%{counters[counter]}"
                if step is None:
                    entry = text.address("i64", f"%.t{next(number)}", at)
                    moved = text.new(f"load i64, ptr {entry}, align 8")
                else:
                    moved = text.new(f"mul nuw nsw i64 {at}, {step}")
                total = text.new(f"add nuw nsw i64 {total}, {moved}")
            return total

        def innermost() -> None:
            kind = self._width.number
            at = [text.address(kind, f"%.p{k}", index(move)) for k, move in enumerate(moves)]
            text.add(f"call void @leaf.{leaf}({', '.join(f'ptr {at[k]}' for k in order)})")

        def level(k: int) -> None:
            if k == len(counters):
                innermost()
                return
            length = "%.n" if k == 0 else str(lengths[k - 1])
            text.repeat(counters[k], length, lambda: level(k + 1))

        level(0)
        parameters = ["i64 %.n"]
        parameters += [f"ptr {'noalias ' * one}%.p{k}" for k, one in enumerate(alone)]
        parameters += [f"ptr noalias readonly %.t{k}" for k in range(next(number))]
        head = f"define internal void @shared.{len(self._names) - 1}({', '.join(parameters)})"
        return text.function(f"{head} noinline nounwind {self._width.attribute}")


def _nest(loop: Loop) -> tuple[list[str], list[int], Call] | None:
    """Counters, lengths and the body of loops that do nothing but call a small leaf."""
    counters, lengths, inner = [], [], loop
    while isinstance(inner, Loop) and len(inner.body) == 1:
        counters.append(inner.counter)
        lengths.append(inner.length)
        inner = inner.body[0]
    if not isinstance(inner, Call) or len(inner.leaf.operations) > LARGEST_LEAF:
        return None
    least = LEAST if len(lengths) == 1 else LEAST_INSIDE
    return (counters, lengths, inner) if math.prod(lengths) >= least else None
