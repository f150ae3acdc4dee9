"""Statements of a loop program in C99."""

from collections.abc import Iterable

from backsight.engine.c99.leaf import identifier
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

REALS, INTS = "kernel_reals", "kernel_ints"
"""Parts of the work space in which all kernels work."""


class Writer:
    """Statements as lines of C.

    Parameters
    ----------
    place : dict of Buffer to str
        Expression for the address of every buffer.
    real : str
        Type of a number.
    """

    def __init__(self, place: dict[Buffer, str], real: str) -> None:
        self._place = place
        self._real = real
        self._searches = 0

    def lines(self, statements: Iterable[Statement], depth: int) -> list[str]:
        """Write statements, indented by `depth` steps."""
        return [line for s in statements for line in self._statement(s, depth)]

    def copies(self, copies: Iterable[Copy], depth: int) -> list[str]:
        """Write copies."""
        return [line for c in copies for line in self._copy(c, depth)]

    def _statement(self, statement: Statement, depth: int) -> list[str]:
        indent = "    " * depth
        match statement:
            case Call(leaf, inputs, outputs):
                arguments = ", ".join(self._at(s) for s in (*inputs, *outputs))
                return [f"{indent}{identifier(leaf.name)}({arguments});"]
            case Foreign():
                return self._foreign(statement, depth)
            case Copy():
                return self._copy(statement, depth)
            case Loop(counter, length, body):
                return [
                    f"{indent}for (int {counter} = 0; {counter} < {length}; ++{counter}) {{",
                    *self.lines(body, depth + 1),
                    f"{indent}}}",
                ]
            case While(flag, limit, body, update):
                test, count = f"{self._at(flag)}[0] != 0", self._searches
                # A search within a search counts by itself.
                counter = f"pass_{count + 1}" if count else "pass"
                self._searches += 1
                inside = [*self.lines(body, depth + 1), *self.copies(update, depth + 1)]
                self._searches -= 1
                head = f"for (int {counter} = 0; {counter} < {limit} && {test}; ++{counter}) {{"
                return [f"{indent}{head}", *inside, f"{indent}}}"]

    def _foreign(self, call: Foreign, depth: int) -> list[str]:
        indent, sizes = "    " * depth, call.kernel.sizes or (0,)
        inputs, outputs = ([self._at(s) for s in group] for group in (call.inputs, call.outputs))
        return [
            f"{indent}{{",
            f"{indent}    static const int sizes[{len(sizes)}] = {{{listed(map(str, sizes))}}};",
            f"{indent}    const {self._real} *const arg[{len(inputs)}] = {{{listed(inputs)}}};",
            f"{indent}    {self._real} *const res[{len(outputs)}] = {{{listed(outputs)}}};",
            f"{indent}    {call.kernel.name}(sizes, arg, res, work->{REALS}, work->{INTS});",
            f"{indent}}}",
        ]

    def _copy(self, copy: Copy, depth: int) -> list[str]:
        indent, n = "    " * depth, copy.source.size
        to, source = self._at(copy.target), self._at(copy.source)
        if n == 1:
            return [f"{indent}{to}[0] = {source}[0];"]
        same = copy.source.buffer == copy.target.buffer
        if same and (copy.source.strides or copy.target.strides):
            return [
                f"{indent}{{",
                f"{indent}    {self._real} held[{n}];",
                f"{indent}    for (int i = 0; i < {n}; ++i)",
                f"{indent}        held[i] = {source}[i];",
                f"{indent}    for (int i = 0; i < {n}; ++i)",
                f"{indent}        {to}[i] = held[i];",
                f"{indent}}}",
            ]
        upwards = not (same and copy.target.offset > copy.source.offset)
        order = f"int i = 0; i < {n}; ++i" if upwards else f"int i = {n - 1}; i >= 0; --i"
        return [f"{indent}for ({order})", f"{indent}    {to}[i] = {source}[i];"]

    def _at(self, place: Slice) -> str:
        terms = [str(place.offset)] if place.offset or not place.strides else []
        for counter, stride in place.strides:
            moved = (
                f"table_{stride.name}[{counter}]"
                if isinstance(stride, Table)
                else f"{stride} * {counter}"
            )
            terms.append(moved)
        index = " + ".join(terms)
        base = self._place[place.buffer]
        return base if index == "0" else f"({base} + {index})"


def listed(values: Iterable[str]) -> str:
    """Values of an initialiser, in rows."""
    items = list(values)
    rows = [", ".join(items[i : i + 6]) for i in range(0, len(items), 6)]
    return rows[0] if len(rows) == 1 else "\n        " + ",\n        ".join(rows)
