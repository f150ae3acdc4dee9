"""Straight-line arithmetic: an SX function as a list of numbered operations."""

import dataclasses
import functools
import itertools
import re
from collections.abc import Sequence
from typing import TypeAlias

import casadi as ca

from backsight.errors import EngineError

OPERATIONS = {
    ca.OP_ADD: "add", ca.OP_SUB: "sub", ca.OP_MUL: "mul", ca.OP_DIV: "div", ca.OP_NEG: "neg",
    ca.OP_SQRT: "sqrt", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p",
    ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_HYPOT: "hypot",
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_ATAN2: "atan2",
    ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh", ca.OP_ACOSH: "acosh", ca.OP_ATANH: "atanh", ca.OP_ERF: "erf",
    ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_FMOD: "fmod", ca.OP_REMAINDER: "remainder",
    ca.OP_COPYSIGN: "copysign", ca.OP_SIGN: "sign",
    ca.OP_LT: "lt", ca.OP_LE: "le", ca.OP_EQ: "eq", ca.OP_NE: "ne",
    ca.OP_NOT: "not", ca.OP_AND: "and", ca.OP_OR: "or", ca.OP_IF_ELSE_ZERO: "select",
}  # fmt: skip
"""Operations of CasADi that a back end writes, by their name in `Operation`."""

SAME = {ca.OP_ASSIGN, ca.OP_LIFT}


@dataclasses.dataclass(frozen=True)
class Operation:
    """One number.

    Parameters
    ----------
    kind : str
        ``input`` (arguments: which input, which number of it), ``const``, or one of `OPERATIONS`,
        whose arguments are the positions of earlier operations. Comparisons and logic give 1 or 0.
        ``select`` has three arguments: where the first is not zero the second, else the third.
    arguments : tuple of int
    value : float
        Of a ``const``.
    """

    kind: str
    arguments: tuple[int, ...] = ()
    value: float = 0.0


@dataclasses.dataclass(frozen=True)
class Leaf:
    """A function without loops or branches.

    Parameters
    ----------
    name : str
    inputs : tuple of int
        Lengths of the arguments; of a sparse matrix only the entries that are there.
    operations : tuple of Operation
    outputs : tuple of tuple of int
        For each result the operations whose numbers it holds.
    names : tuple of str
        Of the arguments and then of the results; for people only.
    """

    name: str
    inputs: tuple[int, ...]
    operations: tuple[Operation, ...]
    outputs: tuple[tuple[int, ...], ...]
    names: tuple[str, ...]

    def __hash__(self) -> int:
        return hash((self.name, self.inputs, len(self.operations)))


class _Recorder:
    """Operations so far; the same operation on the same arguments is recorded once."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._known: dict[tuple[str, tuple[int, ...], str], int] = {}

    def add(self, kind: str, *arguments: int, value: float = 0.0) -> int:
        key = kind, arguments, value.hex()
        if key not in self._known:
            self._known[key] = len(self.operations)
            self.operations.append(Operation(kind, arguments, value))
        return self._known[key]

    def sum(self, a: int, b: int) -> int:
        """Add, but the two halves of an `if_else` become one choice."""
        first, second = self.operations[a], self.operations[b]
        if first.kind == second.kind == "select" and self._is_zero(first) and self._is_zero(second):
            condition = self.operations[second.arguments[0]]
            if condition.kind == "not" and condition.arguments[0] == first.arguments[0]:
                return self.add("select", *first.arguments[:2], second.arguments[1])
        return self.add("add", a, b)

    def _is_zero(self, choice: Operation) -> bool:
        otherwise = self.operations[choice.arguments[2]]
        return otherwise.kind == "const" and otherwise.value == 0


def leaf_of(function: ca.Function) -> Leaf:
    """Read the instructions of an SX function.

    Raises
    ------
    EngineError
        If it contains an operation that cannot be written.
    """
    record = _Recorder()
    work: dict[int, int] = {}
    outputs = [[-1] * function.nnz_out(i) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[targets[0]] = record.add("input", *sources)
        elif operation == ca.OP_OUTPUT:
            outputs[targets[0]][targets[1]] = work[sources[0]]
        elif operation == ca.OP_CONST:
            work[targets[0]] = record.add("const", value=function.instruction_constant(k))
        else:
            arguments = [work[s] for s in sources]
            work[targets[0]] = _operation(function.name(), operation, arguments, record)
    zero = record.add("const", value=0.0) if any(-1 in o for o in outputs) else -1
    sizes = tuple(function.nnz_in(i) for i in range(function.n_in()))
    results = tuple(tuple(zero if k < 0 else k for k in output) for output in outputs)
    operations = tuple(record.operations)
    return without_unused(Leaf(function.name(), sizes, operations, results, _names(function)))


def _names(function: ca.Function) -> tuple[str, ...]:
    """Names of arguments and results; an argument without one is called as its symbol."""
    names: list[str] = []
    for k in range(function.n_in()):
        name, symbols = function.name_in(k), [str(s) for s in function.sx_in(k).nonzeros()]
        called = {re.sub(r"_\d+$", "", s) for s in symbols} if len(symbols) > 1 else {*symbols}
        if name == f"i{k}" and len(called) == 1:
            name = called.pop()
        plain = re.fullmatch(r"(?![io]\d)[A-Za-z]\w*", name, re.ASCII) and name not in names
        names.append(name if plain else f"i{k}")
    return (*names, *(function.name_out(j) for j in range(function.n_out())))


Part: TypeAlias = tuple[Leaf, list[tuple[int, int]]]
"""A leaf for some of the results of another, and for each where it begins: output and number."""

LARGEST_WHOLE = 1000
"""Operations in a leaf that is not taken apart; compilers take time with the square of them."""

PART = 300
"""Operations in a part of a leaf."""


def leaf_parts(leaf: Leaf) -> list[Part]:
    """Take a large leaf apart into leaves for some of the results, if these share little."""
    whole = [(leaf, [(j, 0) for j in range(len(leaf.outputs))])]
    if len(leaf.operations) <= LARGEST_WHOLE:
        return whole
    parts, total = [], 0
    wanted: list[tuple[int, int]] = []
    needed: set[int] = set()
    for j, output in enumerate(leaf.outputs):
        for i, k in enumerate(output):
            wanted.append((j, i))
            needed |= _needed(leaf.operations, {k} - needed)
            if len(needed) > PART:
                parts.append(wanted)
                total += len(needed)
                wanted, needed = [], set()
    if total + len(needed) > 1.5 * len(leaf.operations):
        return whole
    return [_part(leaf, places) for places in (*parts, wanted) if places]


def _part(leaf: Leaf, places: list[tuple[int, int]]) -> Part:
    pieces = [list(group) for _, group in itertools.groupby(places, lambda place: place[0])]
    outputs = tuple(tuple(leaf.outputs[j][i] for j, i in piece) for piece in pieces)
    n = len(leaf.inputs)
    names = (*leaf.names[:n], *(leaf.names[n + piece[0][0]] for piece in pieces))
    part = dataclasses.replace(leaf, outputs=outputs, names=names)
    return without_unused(part), [piece[0] for piece in pieces]


def _needed(operations: Sequence[Operation], wanted: set[int]) -> set[int]:
    """The given operations and all on which they depend."""
    needed, new = set(wanted), list(wanted)
    while new:
        operation = operations[new.pop()]
        if operation.kind != "input":
            added = set(operation.arguments) - needed
            needed |= added
            new += added
    return needed


def without_unused(leaf: Leaf) -> Leaf:
    """The leaf without operations that no result needs."""
    needed = _needed(leaf.operations, {k for output in leaf.outputs for k in output})
    new = {old: position for position, old in enumerate(sorted(needed))}
    kept = (leaf.operations[old] for old in new)
    operations = tuple(
        o if o.kind == "input" else Operation(o.kind, tuple(new[a] for a in o.arguments), o.value)
        for o in kept
    )
    outputs = tuple(tuple(new[k] for k in output) for output in leaf.outputs)
    return dataclasses.replace(leaf, operations=operations, outputs=outputs)


def _operation(name: str, operation: int, arguments: list[int], record: _Recorder) -> int:
    if operation in SAME:
        return arguments[0]
    if operation == ca.OP_ADD:
        return record.sum(*arguments)
    if operation == ca.OP_SQ:
        return record.add("mul", arguments[0], arguments[0])
    if operation == ca.OP_TWICE:
        return record.add("add", arguments[0], arguments[0])
    if operation == ca.OP_INV:
        return record.add("div", record.add("const", value=1.0), arguments[0])
    if operation == ca.OP_IF_ELSE_ZERO:
        return record.add("select", *arguments, record.add("const", value=0.0))
    if operation not in OPERATIONS:
        raise EngineError(
            f"'{name}' uses the operation {operation_name(operation)}, which cannot be compiled; "
            "use engine='vm' or write the model without it"
        )
    return record.add(OPERATIONS[operation], *arguments)


def operation_name(operation: int) -> str:
    """Return CasADi's name of an operation code."""
    return _operation_names().get(operation, f"number {operation}")


@functools.cache
def _operation_names() -> dict[int, str]:
    return {getattr(ca, n): n.removeprefix("OP_") for n in dir(ca) if n.startswith("OP_")}
