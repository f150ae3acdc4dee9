"""A loop program in C99: readable, without allocation, recursion or global variables."""

import dataclasses
import re
from collections.abc import Iterable, Sequence

from backsight.engine.c99_leaf import Precision, identifier, write_leaf
from backsight.engine.program import (
    Buffer,
    Call,
    Copy,
    Loop,
    Program,
    Slice,
    Statement,
    Table,
    While,
)


@dataclasses.dataclass(frozen=True)
class Source:
    """C code of one recursion.

    Parameters
    ----------
    header, code : str
        Texts of ``name.h`` and ``name.c``.
    memory, workspace : int
        Numbers that the caller keeps between samples, and lends for the time of a step.
    operations : int
        Arithmetic operations in all functions together, each counted once.
    """

    header: str
    code: str
    memory: int
    workspace: int
    operations: int


def write(
    program: Program,
    *,
    name: str,
    start: Sequence[float],
    results: Sequence[str],
    precision: Precision,
    about: str,
) -> Source:
    """Write a program as C99.

    Parameters
    ----------
    program : Program
    name : str
        Prefix of everything that is visible outside; an identifier.
    start : sequence of float
        The memory before the first sample.
    results : sequence of str
        Names of the outputs.
    precision : Precision
    about : str
        Comment at the top of both files.
    """
    working = [b for b in program.buffers if b.values is None]
    size = sum(max(b.size, 1) for b in working)
    return Source(
        header=_header(program, working, name=name, results=results, kind=precision, about=about),
        code=_code(program, name=name, start=start, results=results, kind=precision, about=about),
        memory=program.carry.size,
        workspace=size,
        operations=sum(
            operation.kind not in ("input", "const")
            for leaf in program.leaves
            for operation in leaf.operations
        ),
    )


def _signature(program: Program, name: str, results: Sequence[str]) -> str:
    lines = [f"{name}_memory *memory", f"{name}_workspace *work"]
    lines += [f"const {name}_real *{b.name}" for b in program.inputs]
    lines += [f"{name}_real *{r}" for r in results]
    joint = ",\n    ".join(lines)
    return f"void {name}_step(\n    {joint})"


def _header(
    program: Program,
    working: Sequence[Buffer],
    *,
    name: str,
    results: Sequence[str],
    kind: Precision,
    about: str,
) -> str:
    guard = f"{name.upper()}_H"
    fields = [f"    {name}_real {identifier(b.name)}[{max(b.size, 1)}];" for b in working]
    sizes = [
        f"   {label:<8} [{b.size}]"
        for label, b in (
            *((b.name, b) for b in program.inputs),
            *zip(results, program.outputs, strict=True),
        )
    ]
    return "\n".join(
        [
            _comment(about),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"typedef {kind.name} {name}_real;",
            "",
            "/* Everything that is kept from sample to sample. */",
            "typedef struct {",
            f"    {name}_real carry[{program.carry.size}];",
            f"}} {name}_memory;",
            "",
            "/* Scratch space; its content does not matter between two calls. */",
            "typedef struct {",
            *(fields or [f"    {name}_real none[1];"]),
            f"}} {name}_workspace;",
            "",
            "/* Set the memory to its state before the first sample. */",
            f"void {name}_init({name}_memory *memory);",
            "",
            "/* Process one sample. Sizes of the arguments:",
            *sizes,
            "   Symmetric matrices are lower triangles, column by column. */",
            f"{_signature(program, name, results)};",
            "",
            "#endif",
            "",
        ]
    )


def _code(
    program: Program,
    *,
    name: str,
    start: Sequence[float],
    results: Sequence[str],
    kind: Precision,
    about: str,
) -> str:
    place = {b: f"work->{identifier(b.name)}" for b in program.buffers if b.values is None}
    place |= {b: identifier(b.name) for b in program.buffers if b.values is not None}
    place |= {b: b.name for b in program.inputs}
    place |= dict(zip(program.outputs, results, strict=True))
    place[program.carry] = "memory->carry"
    writer = _Writer(place, f"{name}_real")
    constants = [
        f"    static const {name}_real {identifier(b.name)}[{max(b.size, 1)}] = "
        f"{{{_list(kind.number(v) for v in b.values or (0.0,))}}};"
        for b in program.buffers
        if b.values is not None
    ]
    tables = [
        f"    static const int table_{t.name}[{len(t.values)}] = {{{_list(map(str, t.values))}}};"
        for t in program.tables
    ]
    body = [*writer.lines(program.body, 1), *writer.copies(program.update, 1)]
    text = "\n".join(body)
    kept = [c for c in (*constants, *tables) if _declared(c) in text]
    unused = [
        f"    (void){p};"
        for p in (*(b.name for b in program.inputs), "work")
        if not _mentions(text, p)
    ]
    values = _list(kind.number(v) for v in start)
    return "\n\n".join(
        [
            f'{_comment(about)}\n#include <math.h>\n\n#include "{name}.h"',
            *(write_leaf(leaf, f"{name}_real", kind) for leaf in program.leaves),
            "\n".join(
                [
                    f"void {name}_init({name}_memory *memory)",
                    "{",
                    f"    static const {name}_real start[{len(start)}] = {{{values}}};",
                    "    int i;",
                    f"    for (i = 0; i < {len(start)}; ++i)",
                    "        memory->carry[i] = start[i];",
                    "}",
                ]
            ),
            "\n".join([_signature(program, name, results), "{", *kept, *unused, *body, "}", ""]),
        ]
    )


class _Writer:
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
            case Copy():
                return self._copy(statement, depth)
            case Loop(counter, length, body):
                return [
                    f"{indent}for (int {counter} = 0; {counter} < {length}; ++{counter}) {{",
                    *self.lines(body, depth + 1),
                    f"{indent}}}",
                ]
            case While(flag, limit, body, update):
                test = f"{self._at(flag)}[0] != 0"
                return [
                    f"{indent}for (int pass = 0; pass < {limit} && {test}; ++pass) {{",
                    *self.lines(body, depth + 1),
                    *self.copies(update, depth + 1),
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


def _comment(text: str) -> str:
    return "/* " + text.replace("*/", "* /").replace("\n", "\n   ") + " */"


def _list(values: Iterable[str]) -> str:
    items = list(values)
    rows = [", ".join(items[i : i + 6]) for i in range(0, len(items), 6)]
    return rows[0] if len(rows) == 1 else "\n        " + ",\n        ".join(rows)


def _declared(line: str) -> str:
    return line.split("[")[0].split()[-1]


def _mentions(text: str, name: str) -> bool:
    return re.search(rf"\b{re.escape(name)}\b", text) is not None
