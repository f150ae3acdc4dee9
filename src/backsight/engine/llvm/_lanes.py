"""Rows of several recordings, put together lane by lane and taken apart again."""

from collections.abc import Sequence

from backsight.engine.llvm._statements import Statements
from backsight.engine.llvm._text import LARGEST_UNROLLED, Text
from backsight.engine.llvm.width import Width
from backsight.engine.program import Buffer, Program, Slice


class Lanes:
    """One step of several recordings.

    Parameters
    ----------
    program : Program
    text : Text
        At the start of the function.
    width : Width
    rows : dict of Buffer to list of str
        Addresses of the first row in every lane.
    """

    def __init__(
        self, program: Program, text: Text, width: Width, rows: dict[Buffer, list[str]]
    ) -> None:
        self._program, self._text, self._width, self._rows = program, text, width, rows
        for buffer in (*program.inputs, *program.outputs):
            text.add(f"%{buffer.name} = alloca [{buffer.size} x {width.number}], align 64")

    def write(self, statements: Statements) -> None:
        """Write the step for the counter ``%.sample``."""
        n = self._width.lanes
        statements.active = "<" + ", ".join(["i1 true"] * n) + ">"
        for buffer in self._program.inputs:
            self._gather(buffer, statements)
        statements.write(self._program.body)
        statements.update(self._program.update, None)
        for buffer in self._program.outputs:
            self._spread(buffer, statements)

    def _gather(self, buffer: Buffer, statements: Statements) -> None:
        rows = self._here(buffer)

        def one(k: int | str) -> None:
            vector = "poison"
            for lane, row in enumerate(rows):
                place = self._text.address("double", row, _index(k))
                number = self._text.new(f"load double, ptr {place}, align 8")
                kind = self._width.number
                vector = self._text.new(
                    f"insertelement {kind} {vector}, double {number}, i32 {lane}"
                )
            statements.store(buffer.whole(), k, vector)

        self._text.each(buffer.size, one)

    def _spread(self, buffer: Buffer, statements: Statements) -> None:
        """Write the rows, as many numbers at once as there are lanes."""
        text, rows, n = self._text, self._here(buffer), self._width.lanes
        whole, rest = buffer.whole(), buffer.size % n

        def several(k: int | str) -> None:
            if isinstance(k, int):
                self._turn(whole.part(n * k, n), n * k, rows, statements)
            else:
                first = text.new(f"mul nuw nsw i64 %{k}, {n}")
                self._turn(whole.part(0, n).moving(k, n), first, rows, statements)

        text.each(buffer.size // n, several, unrolled=LARGEST_UNROLLED // n)
        if rest:
            self._turn(whole.part(buffer.size - rest, rest), buffer.size - rest, rows, statements)

    def _turn(
        self, numbers: Slice, first: int | str, rows: list[str], statements: Statements
    ) -> None:
        """Write at most as many numbers as there are lanes, to place `first` of all rows."""
        vectors = [statements.load(numbers, k) for k in range(numbers.size)]
        empty = ["poison"] * (self._width.lanes - numbers.size)
        for row, part in zip(rows, self._transposed([*vectors, *empty]), strict=True):
            some = self._shuffled(part, part, range(numbers.size))
            place = self._text.address("double", row, first)
            self._text.add(f"store <{numbers.size} x double> {some}, ptr {place}, align 8")

    def _here(self, buffer: Buffer) -> list[str]:
        """Addresses of the rows of this sample."""
        start = self._text.new(f"mul nuw nsw i64 %.sample, {buffer.size}")
        return [self._text.address("double", row, start) for row in self._rows[buffer]]

    def _transposed(self, vectors: list[str]) -> list[str]:
        """Turn n vectors of n numbers around, n a power of two, by interleaving halves."""
        n = len(vectors)
        low = [k for pair in zip(range(n // 2), range(n, n + n // 2), strict=True) for k in pair]
        high = [k + n // 2 for k in low]
        for _ in range(n.bit_length() - 1):
            pairs = zip(vectors[: n // 2], vectors[n // 2 :], strict=True)
            vectors = [self._shuffled(a, b, order) for a, b in pairs for order in (low, high)]
        return vectors

    def _shuffled(self, a: str, b: str, order: Sequence[int]) -> str:
        kind = self._width.number
        mask = f"<{len(order)} x i32> <{', '.join(f'i32 {k}' for k in order)}>"
        return self._text.new(f"shufflevector {kind} {a}, {kind} {b}, {mask}")


def _index(k: int | str) -> int | str:
    return k if isinstance(k, int) else f"%{k}"
