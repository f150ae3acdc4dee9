"""Statements of a loop program in LLVM's language."""

from backsight.engine.llvm._shared import SharedLoops
from backsight.engine.llvm._text import Text
from backsight.engine.llvm.foreign import SPACE, called
from backsight.engine.llvm.width import Width
from backsight.engine.program import (
    Buffer,
    Call,
    Copy,
    Foreign,
    Loop,
    Slice,
    Statement,
    Table,
    While,
)


class Statements:
    """Writes statements to a text.

    Parameters
    ----------
    text : Text
    width : Width
    base : dict of Buffer to str
        Address of every buffer.
    shared : SharedLoops
        Where long loops are written.
    longest : int
        Numbers of a copy that is written out.
    """

    def __init__(
        self,
        text: Text,
        width: Width,
        base: dict[Buffer, str],
        shared: SharedLoops,
        longest: int,
    ) -> None:
        self._text = text
        self._width = width
        self._base = base
        self._shared = shared
        self._longest = longest
        self.active: str | None = None
        """Condition that holds in the lanes whose results count here; None with one lane."""

    def write(self, statements: tuple[Statement, ...]) -> None:
        """Write all of them."""
        for statement in statements:
            match statement:
                case Call(leaf, inputs, outputs):
                    arguments = ", ".join(f"ptr {self._at(s)}" for s in (*inputs, *outputs))
                    self._text.add(f"call void @leaf.{leaf.name}({arguments})")
                case Foreign():
                    self._foreign(statement)
                case Copy():
                    self._copy(statement)
                case Loop() if self._shared.write(statement, self._text, self._at):
                    pass
                case Loop(counter, length, body):
                    self._text.repeat(counter, str(length), lambda b=body: self.write(b))
                case While():
                    self._while(statement)

    def update(self, copies: tuple[Copy, ...], where: str | None) -> None:
        """Write copies that only count in the lanes where the condition holds."""
        for copy in copies:
            if where is None:
                self._copy(copy)
            else:
                self._text.each(copy.source.size, lambda k, c=copy: self._choose(c, k, where))

    def load(self, place: Slice, k: int | str) -> str:
        """Read number k of a slice."""
        address = self._at(_number(place, k))
        return self._text.new(f"load {self._width.number}, ptr {address}, align 8")

    def store(self, place: Slice, k: int | str, value: str) -> None:
        """Write number k of a slice."""
        address = self._at(_number(place, k))
        self._text.add(f"store {self._width.number} {value}, ptr {address}, align 8")

    def _foreign(self, call: Foreign) -> None:
        arguments = [f"ptr {self._at(s)}" for s in (*call.inputs, *call.outputs)]
        arguments.append(f"ptr {SPACE}")
        if self.active is not None:
            n = self._width.lanes
            bits = self._text.new(f"bitcast {self._width.truth} {self.active} to i{n}")
            arguments.append(f"i{n} {bits}")
        self._text.add(f"call void {called(call)}({', '.join(arguments)})")

    def _choose(self, copy: Copy, k: int | str, where: str) -> None:
        kind = self._width.number
        new, old = self.load(copy.source, k), self.load(copy.target, k)
        chosen = f"select {self._width.truth} {where}, {kind} {new}, {kind} {old}"
        self.store(copy.target, k, self._text.new(chosen))

    def _copy(self, copy: Copy) -> None:
        if copy.source.size <= self._longest:
            values = [self.load(copy.source, k) for k in range(copy.source.size)]
            for k, value in enumerate(values):
                self.store(copy.target, k, value)
            return
        size = 8 * self._width.lanes * copy.source.size
        values = copy.source.buffer.values
        if values is not None and not any(values):  # zeros need not be read
            target = f"ptr {self._at(copy.target)}, i8 0, i64 {size}, i1 false"
            self._text.add(f"call void @llvm.memset.p0.i64({target})")
            return
        addresses = f"ptr {self._at(copy.target)}, ptr {self._at(copy.source)}"
        self._text.add(f"call void @llvm.memmove.p0.p0.i64({addresses}, i64 {size}, i1 false)")

    def _while(self, loop: While) -> None:
        where: list[str | None] = []

        def test() -> str:
            lanes, any_lane = self._running(self.load(loop.flag, 0))
            where.append(lanes)
            return any_lane

        def body() -> None:
            outside, self.active = self.active, where[0]
            self.write(loop.body)
            self.active = outside
            self.update(loop.update, where[0])

        self._text.repeat_while(loop.limit, test, body)

    def _running(self, flag: str) -> tuple[str | None, str]:
        """Lanes whose flag is not zero (None with one lane), and whether there are any."""
        text, truth, n = self._text, self._width.truth, self._width.lanes
        go = text.new(f"fcmp une {self._width.number} {flag}, {self._width.constant(0.0)}")
        if self.active is None:
            return None, go
        where = text.new(f"and {truth} {go}, {self.active}")
        bits = text.new(f"bitcast {truth} {where} to i{n}")
        return where, text.new(f"icmp ne i{n} {bits}, 0")

    def _at(self, place: Slice) -> str:
        index = str(place.offset)
        for counter, stride in place.strides:
            if isinstance(stride, Table):
                entry = self._text.address("i64", f"@table.{stride.name}", f"%{counter}")
                moved = self._text.new(f"load i64, ptr {entry}, align 8")
            else:
                moved = self._text.new(f"mul nuw nsw i64 %{counter}, {stride}")
            index = self._text.new(f"add nuw nsw i64 {index}, {moved}")
        return self._text.address(self._width.number, self._base[place.buffer], index)


def _number(place: Slice, k: int | str) -> Slice:
    return place.part(k, 1) if isinstance(k, int) else place.part(0, 1).moving(k, 1)
