"""Rows of several recordings, put together lane by lane and taken apart again."""

from backsight.engine.llvm_leaf import Width
from backsight.engine.llvm_statements import Statements
from backsight.engine.llvm_text import Text
from backsight.engine.program import Buffer, Program


class Lanes:
    """One step of several recordings.

    A recording that has ended is fed with its last sample; its memory and results stay.

    Parameters
    ----------
    program : Program
    text : Text
        At the start of the function.
    width : Width
    rows : dict of Buffer to list of str
        Addresses of the first row in every lane.
    lengths : str
        Address of the lengths of the recordings; one of length 0 still has a first row to read.
    """

    def __init__(
        self,
        program: Program,
        text: Text,
        width: Width,
        rows: dict[Buffer, list[str]],
        lengths: str,
    ) -> None:
        self._program, self._text, self._width, self._rows = program, text, width, rows
        for buffer in (*program.inputs, *program.outputs):
            text.add(f"%{buffer.name} = alloca [{buffer.size} x {width.number}], align 64")
        largest = max((b.size for b in program.outputs), default=1)
        text.add(f"%.nowhere = alloca [{largest} x double], align 64")
        places = [text.address("i64", lengths, lane) for lane in range(width.lanes)]
        self._lengths = [text.new(f"load i64, ptr {p}, align 8") for p in places]
        more = [text.new(f"icmp ugt i64 {length}, 1") for length in self._lengths]
        before = [text.new(f"sub i64 {length}, 1") for length in self._lengths]
        self._last = [
            text.new(f"select i1 {m}, i64 {b}, i64 0") for m, b in zip(more, before, strict=True)
        ]

    def write(self, statements: Statements) -> None:
        """Write the step for the counter ``%.sample``."""
        text, n = self._text, self._width.lanes
        going = [text.new(f"icmp ult i64 %.sample, {length}") for length in self._lengths]
        now = [
            text.new(f"select i1 {go}, i64 %.sample, i64 {last}")
            for go, last in zip(going, self._last, strict=True)
        ]
        statements.active = self._together("i1", going)
        for buffer in self._program.inputs:
            rows = [self._row(buffer, lane, now[lane]) for lane in range(n)]
            text.each(
                buffer.size,
                lambda k, b=buffer, r=rows: statements.store(b.whole(), k, self._read(r, k)),
            )
        statements.write(self._program.body)
        statements.update(self._program.update, statements.active)
        for buffer in self._program.outputs:
            rows = [self._row(buffer, lane, now[lane]) for lane in range(n)]
            targets = [
                text.new(f"select i1 {go}, ptr {row}, ptr %.nowhere")
                for go, row in zip(going, rows, strict=True)
            ]
            text.each(
                buffer.size,
                lambda k, b=buffer, t=targets: self._spread(statements.load(b.whole(), k), t, k),
            )

    def _row(self, buffer: Buffer, lane: int, sample: str) -> str:
        start = self._text.new(f"mul nuw nsw i64 {sample}, {buffer.size}")
        return self._text.address("double", self._rows[buffer][lane], start)

    def _read(self, rows: list[str], k: int | str) -> str:
        places = [self._text.address("double", row, _index(k)) for row in rows]
        return self._together(
            "double", [self._text.new(f"load double, ptr {p}, align 8") for p in places]
        )

    def _spread(self, vector: str, rows: list[str], k: int | str) -> None:
        for lane, row in enumerate(rows):
            number = self._text.new(f"extractelement {self._width.number} {vector}, i32 {lane}")
            place = self._text.address("double", row, _index(k))
            self._text.add(f"store double {number}, ptr {place}, align 8")

    def _together(self, kind: str, values: list[str]) -> str:
        vector, n = "poison", len(values)
        for lane, value in enumerate(values):
            vector = self._text.new(
                f"insertelement <{n} x {kind}> {vector}, {kind} {value}, i32 {lane}"
            )
        return vector


def _index(k: int | str) -> int | str:
    return k if isinstance(k, int) else f"%{k}"
