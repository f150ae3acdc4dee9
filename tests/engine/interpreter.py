"""Loop programs executed in Python, statement by statement: slow and obvious."""

import numpy as np

from backsight.engine.foreign import Kernel
from backsight.engine.program import (
    Call,
    Copy,
    Foreign,
    Leaf,
    Loop,
    Program,
    Slice,
    Statement,
    Table,
    While,
)

ARITHMETIC = {"add": np.add, "sub": np.subtract, "mul": np.multiply, "sin": np.sin}
Memory = dict[str, np.ndarray]


def run(program: Program, carry: np.ndarray, data: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """One step: the new carry and the outputs."""
    memory = {b.name: np.full(b.size, np.nan) for b in program.buffers}
    memory |= {b.name: np.array(b.values) for b in program.buffers if b.values is not None}
    memory |= {b.name: np.full(b.size, np.nan) for b in program.outputs}
    memory |= {b.name: np.array(d) for b, d in zip(program.inputs, data, strict=True)}
    memory[program.carry.name] = np.array(carry)
    _statements((*program.body, *program.update), memory, {})
    return memory[program.carry.name], *(memory[b.name] for b in program.outputs)


def _statements(
    statements: tuple[Statement, ...], memory: Memory, counters: dict[str, int]
) -> None:
    def place(s: Slice) -> tuple[np.ndarray, slice]:
        start = s.offset
        for counter, stride in s.strides:
            now = counters[counter]
            start += stride.values[now] if isinstance(stride, Table) else stride * now
        assert 0 <= start <= start + s.size <= s.buffer.size
        return memory[s.buffer.name], slice(start, start + s.size)

    for statement in statements:
        match statement:
            case Call(leaf, inputs, outputs):
                arguments = [array[part].copy() for array, part in map(place, inputs)]
                for target, values in zip(outputs, _leaf(leaf, arguments), strict=True):
                    array, part = place(target)
                    array[part] = values
            case Foreign(kernel, inputs, outputs):
                for array, part in map(place, outputs):
                    array[part] = np.nan  # a kernel may write before it has read all
                given = [array[part] for array, part in map(place, inputs)]
                results = _kernel(kernel, given)
                for (array, part), values in zip(map(place, outputs), results, strict=True):
                    array[part] = values
            case Copy(source, target):
                (a, i), (b, j) = place(source), place(target)
                for k in range(source.size):
                    b[j.start + k] = a[i.start + k]
            case Loop(counter, length, body):
                for now in range(length):
                    _statements(body, memory, counters | {counter: now})
            case While(flag, limit, body, update):
                for _ in range(limit):
                    array, part = place(flag)
                    if array[part][0] == 0:
                        break
                    _statements((*body, *update), memory, counters)


def _kernel(kernel: Kernel, arguments: list[np.ndarray]) -> list[np.ndarray]:
    assert kernel.name == "matrix_turn"
    assert not kernel.sizes[2]
    return [arguments[0].reshape(kernel.sizes[:2], order="F").ravel()]


def _leaf(leaf: Leaf, arguments: list[np.ndarray]) -> list[np.ndarray]:
    values: list[float] = []
    for operation in leaf.operations:
        if operation.kind == "input":
            i, k = operation.arguments
            values.append(arguments[i][k])
        elif operation.kind == "const":
            values.append(operation.value)
        else:
            operands = [values[a] for a in operation.arguments]
            values.append(ARITHMETIC[operation.kind](*operands))
    return [np.array([values[k] for k in output]) for output in leaf.outputs]
