"""From the step function of a recursion to its loop program."""

import itertools
from collections.abc import Callable, Hashable, Sequence

import casadi as ca

from backsight.engine import loops
from backsight.engine.dense import dense_of
from backsight.engine.foreign import Kernel, kernel_of
from backsight.engine.program._coalesce import without_copies
from backsight.engine.program._glue import ELEMENTWISE, glue, scalar
from backsight.engine.program._in_place import in_place
from backsight.engine.program._moves import in_order
from backsight.engine.program._regroup import regroup
from backsight.engine.program._scope import Scope
from backsight.engine.program._walk_loops import write_entries, write_product
from backsight.engine.program.leaf import Leaf, operation_name
from backsight.engine.program.program import (
    Call,
    Copy,
    Foreign,
    Loop,
    Program,
    Slice,
    Statement,
    While,
)
from backsight.errors import EngineError
from backsight.kernels import library

Pieces = list[Slice]
"""A value as the slices that make it up, one after the other."""

Walked = tuple[list[Statement], list[Pieces]]
"""What a function does, and its results."""


def walk(step: ca.Function) -> Program:
    """Write down a step function as loops over leaves.

    Loop functions (`backsight.engine.loops`) become loops, SX functions leaves, other MX functions
    are taken apart. Values that are only parts of other values are not copied.

    Parameters
    ----------
    step : casadi.Function
        ``(carry, *data) -> (carry, *outputs)``, all dense.

    Raises
    ------
    EngineError
        If the function contains an operation that cannot be written.
    """
    scope = Scope(step.name())
    arguments = [scope.buffer(step.name_in(i), step.nnz_in(i)) for i in range(step.n_in())]
    results = [scope.buffer(step.name_out(i), step.nnz_out(i)) for i in range(1, step.n_out())]
    body, (carry, *outputs) = _function(step, [a.whole() for a in arguments], scope)
    copies = [c for o, r in zip(outputs, results, strict=True) for c in _copies(o, r.whole())]
    program = Program(
        name=step.name(),
        carry=arguments[0],
        inputs=tuple(arguments[1:]),
        outputs=tuple(results),
        body=(*body, *copies),
        update=tuple(in_order(_copies(carry, arguments[0].whole()), scope.scratch)),
    )
    return without_copies(in_place(program))


def _function(function: ca.Function, arguments: Sequence[Slice], scope: Scope) -> Walked:
    """What a function does; where it was called with the same arguments, nothing more."""
    call = _identity(function), tuple(a.place for a in arguments)
    known = scope.results(call)
    if known is None:
        statements, known = _written(function, arguments, scope)
        scope.keep(call, function, known)
        return statements, known
    return [], known


def _identity(function: ca.Function) -> Hashable:
    """What tells a function from others: of kernels and products all is in their name."""
    product = dense_of(function)
    if product is not None:
        return function.name(), *product.pattern.row(), -1, *product.pattern.colind()
    return function.name() if kernel_of(function) else function.__hash__()


def _written(function: ca.Function, arguments: Sequence[Slice], scope: Scope) -> Walked:
    loop = loops.loop_of(function)
    if loop is not None:
        return _loop(function, loop, arguments, scope)
    operation = dense_of(function)
    if operation is not None:
        return write_product(operation, arguments, scope)
    kernel = kernel_of(function)
    if kernel is not None:
        return _foreign(function, kernel, arguments, scope)
    if function.is_a("SXFunction"):
        return _call(scope.leaf(function), arguments, scope)
    if function.is_a("MXFunction"):
        return _instructions(function, arguments, scope)
    raise EngineError(
        f"'{scope.recursion}' calls '{function.name()}', a {function.class_name()}, which cannot "
        "be compiled; use engine='vm' or expand it to an SX function"
    )


def _call(leaf: Leaf, arguments: Sequence[Slice], scope: Scope) -> Walked:
    results = [
        scope.buffer(f"{leaf.name}_{j}", len(output)).whole()
        for j, output in enumerate(leaf.outputs)
    ]
    given = list(results)
    loops, left = write_entries(leaf, arguments, given, scope)
    calls: list[Statement] = []
    for part, places in scope.parts(left) if any(left.outputs) else ():
        targets = [
            given[j].part(first, len(output))
            for (j, first), output in zip(places, part.outputs, strict=True)
        ]
        calls.append(Call(part, tuple(arguments), tuple(targets)))
    return [*calls, *loops], [[r] for r in results]


def _foreign(
    function: ca.Function, kernel: Kernel, arguments: Sequence[Slice], scope: Scope
) -> Walked:
    results = [
        scope.buffer(f"{kernel.name}_{j}", function.nnz_out(j)).whole()
        for j in range(function.n_out())
    ]
    reals, ints = library.work(kernel.name, kernel.sizes)
    call = Foreign(kernel, tuple(arguments), tuple(results), reals, ints)
    return [call], [[r] for r in results]


def _instructions(function: ca.Function, arguments: Sequence[Slice], scope: Scope) -> Walked:
    statements: list[Statement] = []
    outputs: list[Pieces] = [[] for _ in range(function.n_out())]
    work: dict[int, Slice] = {}
    for k in range(function.n_instructions()):
        operation, node = function.instruction_id(k), function.instruction_MX(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            at = node.info()
            work[targets[0]] = arguments[at["ind"]].part(at["offset"], node.nnz())
        elif operation == ca.OP_OUTPUT:
            outputs[targets[0]].append(work[sources[0]])
        else:
            values = [
                work[s] if s >= 0 else scope.constant((0.0,) * node.dep(i).nnz())
                for i, s in enumerate(sources)
            ]
            if operation == ca.OP_CALL:
                called = node.which_function()
                added, results = _function(called, values, scope)
            elif operation in ELEMENTWISE and node.nnz() > MOST_AT_ONCE:
                called = scalar(operation, len(values))
                added, results = _each(called, values, node.nnz(), scope)
            elif operation == ca.OP_CONST:
                called = None
                added, results = [], [[scope.constant(tuple(node.to_DM().nonzeros()))]]
            elif moved := regroup(node, operation, values, scope, most=MOST_PIECES):
                called = None
                added, results = moved
            else:
                called = glue(node, operation, scope.recursion)
                added, results = _glue(called, values, scope)
            statements += added
            name = called.name() if called else operation_name(operation).lower()
            for target, pieces in zip(targets, results, strict=True):
                if target >= 0:
                    work[target] = _joined(pieces, name, statements, scope)
    return statements, outputs


MOST_PIECES = 16
"""Results in more pieces are put together by a leaf."""


MOST_AT_ONCE = 64
"""Larger results of an elementwise operation are computed in a loop."""


def _each(function: ca.Function, arguments: Sequence[Slice], size: int, scope: Scope) -> Walked:
    """Apply a function of numbers to each entry; single numbers go with all."""
    result, counter = scope.buffer(function.name(), size).whole(), scope.name("k")
    operands = [a if a.size == 1 else a.part(0, 1).moving(counter, 1) for a in arguments]
    target = result.part(0, 1).moving(counter, 1)
    call = Call(scope.leaf(function), tuple(operands), (target,))
    return [Loop(counter, size, (call,))], [[result]]


def _glue(function: ca.Function, arguments: Sequence[Slice], scope: Scope) -> Walked:
    """Apply a small function; one that only moves numbers gives pieces of its arguments."""
    leaf = scope.leaf(function)
    if all(leaf.operations[k].kind in ("input", "const") for o in leaf.outputs for k in o):
        results = [_pieces(leaf, output, arguments, scope) for output in leaf.outputs]
        if max(map(len, results)) <= MOST_PIECES:
            return [], results
    return _call(leaf, arguments, scope)


def _pieces(leaf: Leaf, output: Sequence[int], arguments: Sequence[Slice], scope: Scope) -> Pieces:
    def neighbours(place: tuple[int, int]) -> tuple[int, int]:
        position, k = place
        operation = leaf.operations[k]
        if operation.kind == "const":
            return -1, 0
        argument, number = operation.arguments
        return argument, number - position

    pieces: Pieces = []
    for (argument, shift), group in itertools.groupby(enumerate(output), neighbours):
        places = list(group)
        if argument < 0:
            pieces.append(scope.constant(tuple(leaf.operations[k].value for _, k in places)))
        else:
            pieces.append(arguments[argument].part(places[0][0] + shift, len(places)))
    return pieces


def _joined(pieces: Pieces, name: str, statements: list[Statement], scope: Scope) -> Slice:
    """A value in one piece; several are copied together."""
    if len(pieces) == 1:
        return pieces[0]
    value = scope.buffer(name, sum(p.size for p in pieces)).whole()
    statements += _copies(pieces, value)
    return value


def _copies(pieces: Pieces, target: Slice) -> list[Copy]:
    copies, offset = [], 0
    for piece in pieces:
        if piece.size:
            copies.append(Copy(piece, target.part(offset, piece.size)))
        offset += piece.size
    return copies


def _loop(
    function: ca.Function, loop: loops.LoopFunction, arguments: Sequence[Slice], scope: Scope
) -> Walked:
    body, n = loop.body, loop.n_carry
    _check_dense(body, scope.recursion)
    if loop.length == 1 and loop.kind != "iterate":
        return _function(body, arguments, scope)  # once is no loop, and its memory no copy
    counter = scope.name("k")
    carry = [scope.buffer(f"{body.name()}_carry", a.size).whole() for a in arguments[:n]]
    start = [Copy(a, c) for a, c in zip(arguments, carry, strict=False) if a.size]
    at = _places(loop, counter, scope)
    xs = [at(arguments[i], body.nnz_in(i)) for i in range(n, n + loop.n_xs)]
    # What is known in the loop is not known after it, which may make no pass.
    inner, results = _function(body, [*carry, *xs, *arguments[n + loop.n_xs :]], scope.inside())
    stacks = [
        scope.buffer(f"{body.name()}_all", function.nnz_out(i)).whole()
        for i in range(n, function.n_out())
    ]
    columns = [at(s, s.size // loop.length) for s in stacks]
    ends = [c for r, t in zip(results, [*carry, *columns], strict=True) for c in _copies(r, t)]
    update = in_order(ends, scope.scratch)
    if loop.kind == "iterate":
        whole: Statement = While(carry[0], loop.length, tuple(inner), tuple(update))
    else:
        whole = Loop(counter, loop.length, (*inner, *update))
    return [*start, whole], [[v] for v in (*carry, *stacks)]


def _places(loop: loops.LoopFunction, counter: str, scope: Scope) -> Callable[[Slice, int], Slice]:
    """Where in a stack of pieces of some size a pass of the loop finds its piece."""

    def forward(stack: Slice, size: int) -> Slice:
        return stack.part(0, size).moving(counter, size)

    def backward(stack: Slice, size: int) -> Slice:
        places = tuple(size * k for k in reversed(range(loop.length)))
        return stack.part(0, size).moving(counter, scope.table("backward", places))

    return backward if loop.kind == "back" else forward


def _check_dense(body: ca.Function, recursion: str) -> None:
    shapes = [body.sparsity_in(i) for i in range(body.n_in())]
    shapes += [body.sparsity_out(i) for i in range(body.n_out())]
    if not all(s.is_dense() for s in shapes):
        raise EngineError(
            f"'{recursion}' loops over '{body.name()}', some input or output of which is sparse, "
            "which cannot be compiled; use engine='vm' or make it dense with casadi.densify"
        )
