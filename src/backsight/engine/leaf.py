"""Straight-line arithmetic: an SX function as a list of numbered operations."""

import dataclasses

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
    """

    name: str
    inputs: tuple[int, ...]
    operations: tuple[Operation, ...]
    outputs: tuple[tuple[int, ...], ...]

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
    return _without_unused(Leaf(function.name(), sizes, tuple(record.operations), results))


def _without_unused(leaf: Leaf) -> Leaf:
    needed = {k for output in leaf.outputs for k in output}
    for k in reversed(range(len(leaf.operations))):
        if k in needed and leaf.operations[k].kind != "input":
            needed.update(leaf.operations[k].arguments)
    new = {old: position for position, old in enumerate(sorted(needed))}
    operations = (leaf.operations[old] for old in new)
    return Leaf(
        leaf.name,
        leaf.inputs,
        tuple(
            o
            if o.kind == "input"
            else Operation(o.kind, tuple(new[a] for a in o.arguments), o.value)
            for o in operations
        ),
        tuple(tuple(new[k] for k in output) for output in leaf.outputs),
    )


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
    names = {getattr(ca, n): n for n in dir(ca) if n.startswith("OP_")}
    return names.get(operation, f"number {operation}").removeprefix("OP_")
