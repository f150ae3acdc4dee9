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
    real, zero : str
        Type of a number, and how it writes none.
    """

    def __init__(self, place: dict[Buffer, str], real: str, zero: str) -> None:
        self._place = place
        self._real = real
        self._zero = zero
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
                test, count = f"({self._item(flag)} != {self._zero})", self._searches
                # A search within a search counts by itself.
                counter = f"pass_{count + 1}" if count else "pass"
                self._searches += 1
                inside = [*self.lines(body, depth + 1), *self.copies(update, depth + 1)]
                self._searches -= 1
                head = f"for (int {counter} = 0; ({counter} < {limit}) && {test}; ++{counter}) {{"
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
        to, source = copy.target, copy.source
        if n == 1:
            return [f"{indent}{self._item(to)} = {self._item(source)};"]
        moved = f"{self._item(to, 'i')} = {self._item(source, 'i')};"
        same = source.buffer == to.buffer
        if same and (source.strides or to.strides):
            return [
                f"{indent}{{",
                f"{indent}    {self._real} held[{n}];",
                f"{indent}    for (int i = 0; i < {n}; ++i) {{",
                f"{indent}        held[i] = {self._item(source, 'i')};",
                f"{indent}    }}",
                f"{indent}    for (int i = 0; i < {n}; ++i) {{",
                f"{indent}        {self._item(to, 'i')} = held[i];",
                f"{indent}    }}",
                f"{indent}}}",
            ]
        upwards = not (same and to.offset > source.offset)
        order = f"int i = 0; i < {n}; ++i" if upwards else f"int i = {n - 1}; i >= 0; --i"
        return [f"{indent}for ({order}) {{", f"{indent}    {moved}", f"{indent}}}"]

    def _at(self, place: Slice) -> str:
        """Address of the first number."""
        index = self._index(place)
        base = self._place[place.buffer]
        return f"&{base}[{' + '.join(index)}]" if index else base

    def _item(self, place: Slice, number: str = "") -> str:
        """A number, the first one or that of a counter."""
        index = [*self._index(place), number] if number else self._index(place)
        return f"{self._place[place.buffer]}[{' + '.join(index) or '0'}]"

    def _index(self, place: Slice) -> list[str]:
        """Where a slice begins in its buffer, as a sum; empty at the beginning."""
        terms = [str(place.offset)] if place.offset else []
        for counter, stride in place.strides:
            if isinstance(stride, Table):
                terms.append(f"table_{stride.name}[{counter}]")
            elif stride:
                terms.append(counter if stride == 1 else f"({stride} * {counter})")
        return terms


def listed(values: Iterable[str]) -> str:
    """Values of an initialiser, in rows."""
    items = list(values)
    rows = [", ".join(items[i : i + 6]) for i in range(0, len(items), 6)]
    return rows[0] if len(rows) == 1 else "\n        " + ",\n        ".join(rows)
