"""A loop program in C99: readable, without allocation, recursion or global variables."""

import dataclasses
import re
from collections.abc import Sequence

import numpy as np

from backsight.engine.c99._interface import (
    Interface,
    SettingsField,
    comment,
    settings_setter,
    settings_struct,
)
from backsight.engine.c99._local import local_buffers
from backsight.engine.c99._statements import INTS, REALS, Writer, listed
from backsight.engine.c99.leaf import Precision, identifier, write_c99_leaf
from backsight.engine.program import Beginning, Buffer, Program

LARGE = 256
"""Numbers of a table that may be kept elsewhere than in the code."""


@dataclasses.dataclass(frozen=True)
class Source:
    """C code of one recursion.

    Parameters
    ----------
    header, code : str
        Texts of ``name.h`` and ``name.c``.
    memory, workspace : int
        Numbers that the caller keeps between samples, and lends for the time of a step.
    ints : int
        Integers that the caller lends for the time of a step.
    kernels : tuple of str
        Kernels that the code includes, see `backsight.kernels.sources`.
    operations : int
        Arithmetic operations in all functions together, each counted once.
    tables : tuple of float
        Numbers that are not in the code: the step is given an array of them.
    """

    header: str
    code: str
    memory: int
    workspace: int
    ints: int
    kernels: tuple[str, ...]
    operations: int
    tables: tuple[float, ...]


def write_c99(
    program: Program,
    *,
    name: str,
    start: Sequence[float],
    results: Sequence[str],
    precision: Precision,
    about: str,
    settings: Sequence[SettingsField] = (),
    begin: Beginning | None = None,
    most: float = np.inf,
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
    settings : sequence of SettingsField
        Inputs that become a struct with defaults.
    begin : Beginning, optional
        How the memory before the first sample follows them.
    most : float
        Numbers in constants altogether; if there are more, the large ones are not in the code, see
        `Source.tables`.
    """
    begins = begin is not None
    constant = {b: b.values for b in program.buffers if b.values is not None}
    many = sum(map(len, constant.values())) > most
    kept = {b: values for b, values in constant.items() if many and len(values) >= LARGE}
    interface = Interface(
        name, precision, tuple(results), tuple(settings), about, begins, bool(kept)
    )
    near = set(local_buffers(program))
    working = [b for b in program.buffers if b.values is None and b not in near]
    reals, ints = _space(program)
    size = sum(max(b.size, 1) for b in working) + reals
    return Source(
        header=_header(program, working, interface),
        code=_code(program, interface, start, begin, list(kept)),
        memory=program.carry.size,
        workspace=max(size, 1),
        ints=ints,
        kernels=program.kernels,
        operations=sum(
            operation.kind not in ("input", "const")
            for leaf in program.leaves
            for operation in leaf.operations
        ),
        tables=tuple(v for values in kept.values() for v in values),
    )


def _space(program: Program) -> tuple[int, int]:
    """Numbers and integers in which kernels work; an array in C has at least one."""
    reals, ints = program.space
    return (max(reals, 1), max(ints, 1)) if program.kernels else (0, 0)


def size_of(name: str, argument: str) -> str:
    """Name of the macro that has the size of an argument."""
    return f"{name}_{argument}_SIZE".upper()


def _header(program: Program, working: Sequence[Buffer], to: Interface) -> str:
    name, kind = to.name, to.kind
    guard = f"{name.upper()}_H"
    reals, ints = _space(program)
    fields = [f"    {name}_real {identifier(b.name)}[{max(b.size, 1)}];" for b in working]
    if program.kernels:
        fields += [f"    {name}_real {REALS}[{reals}];", f"    int {INTS}[{ints}];"]
    arguments = {b.name: b.size for b in to.data(program)}
    arguments |= {label: b.size for label, b in zip(to.results, program.outputs, strict=True)}
    sizes = [f"#define {size_of(name, label)} {size}" for label, size in arguments.items()]
    return "\n".join(
        [
            comment(to.about),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"typedef {kind.name} {name}_real;",
            "",
            "/* Sizes of the arguments of a step. */",
            *sizes,
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
            *settings_struct(to),
            "/* Set the memory to its state before the first sample. */",
            f"{to.init};",
            "",
            "/* Process one sample; for the sizes of the arguments see above.",
            "   Symmetric matrices are lower triangles, column by column. */",
            f"{to.step(program)};",
            "",
            "#endif",
            "",
        ]
    )


def _code(
    program: Program,
    to: Interface,
    start: Sequence[float],
    begin: Beginning | None,
    aside: Sequence[Buffer],
) -> str:
    name, kind = to.name, to.kind
    place = {b: f"work->{identifier(b.name)}" for b in program.buffers if b.values is None}
    place |= {b: identifier(b.name) for b in program.buffers if b.values is not None}
    near = local_buffers(program)
    place |= {b: identifier(b.name) for b in near}
    place |= {b: b.name for b in program.inputs}
    kept = {f.name for f in to.settings}
    place |= {b: f"settings->{b.name}" for b in program.inputs if b.name in kept}
    place |= dict(zip(program.outputs, to.results, strict=True))
    place[program.carry] = "memory->carry"
    writer = Writer(place, f"{name}_real", kind.number(0.0))
    constants = [
        f"    static const {name}_real {identifier(b.name)}[{max(b.size, 1)}] = "
        f"{{{listed(kind.typed(v) for v in b.values or (0.0,))}}};"
        for b in program.buffers
        if b.values is not None and b not in aside
    ]
    at = np.cumsum([0, *(b.size for b in aside)])
    constants += [
        f"    const {name}_real *const {identifier(b.name)} = tables + {k};"
        for b, k in zip(aside, at, strict=False)
    ]
    variables = [f"    {name}_real {identifier(b.name)}[{max(b.size, 1)}];" for b in near]
    tables = [
        f"    static const int table_{t.name}[{len(t.values)}] = {{{listed(map(str, t.values))}}};"
        for t in program.tables
    ]
    body = [*writer.lines(program.body, 1), *writer.copies(program.update, 1)]
    text = "\n".join(body)
    declared = [c for c in (*constants, *tables, *variables) if _mentions(text, _declared(c))]
    unused = [
        f"    (void){p};"
        for p in (*(b.name for b in to.data(program)), "work", *(["settings"] if kept else []))
        if not _mentions(text, p)
    ]
    leaves = [*program.leaves, *([begin.leaf] if begin else [])]
    return "\n\n".join(
        [
            f'{comment(to.about)}\n#include <math.h>\n\n#include "{name}.h"',
            *_includes(program.kernels, kind),
            *(write_c99_leaf(leaf, f"{name}_real", kind) for leaf in leaves),
            _setter(to, start, begin),
            *settings_setter(to),
            "\n".join([to.step(program), "{", *declared, *unused, *body, "}", ""]),
        ]
    )


def _setter(to: Interface, start: Sequence[float], begin: Beginning | None) -> str:
    """Definition of what sets the memory."""
    name, kind = to.name, to.kind
    values = listed(kind.typed(v) for v in start)
    lines = [
        to.init,
        "{",
        f"    static const {name}_real start[{len(start)}] = {{{values}}};",
        *([f"    {name}_real own[{len(begin.places)}];"] if begin else []),
        "    int i;",
        f"    for (i = 0; i < {len(start)}; ++i) {{",
        "        memory->carry[i] = start[i];",
        "    }",
    ]
    if begin:
        given = (f"settings->{n}" for n in begin.leaf.names[: len(begin.leaf.inputs)])
        lines.append(f"    {identifier(begin.leaf.name)}({', '.join([*given, 'own'])});")
        lines += [f"    memory->carry[{p}] = own[{k}];" for k, p in enumerate(begin.places)]
    return "\n".join([*lines, "}"])


def _includes(kernels: Sequence[str], kind: Precision) -> list[str]:
    """The kernels become part of this file, so that several exports may be linked together."""
    if not kernels:
        return []
    defined = ["KERNEL static inline", *(["BACKSIGHT_FLOAT"] if kind.name == "float" else [])]
    included = ["kernels.h", *(f"{kernel}.c" for kernel in kernels)]
    lines = [*(f"#define {d}" for d in defined), *(f'#include "{i}"' for i in included)]
    return ["\n".join(lines)]


def _declared(line: str) -> str:
    return re.split(r"\[| =", line)[0].split()[-1]


def _mentions(text: str, name: str) -> bool:
    return re.search(rf"\b{re.escape(name)}\b", text) is not None
