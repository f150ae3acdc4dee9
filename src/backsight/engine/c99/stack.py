"""How much stack a step in C takes at most."""

from backsight.engine.c99._local import local_buffers, local_numbers
from backsight.engine.c99.leaf import FUNCTIONS, Precision
from backsight.engine.program import Copy, Foreign, Leaf, Loop, Program, While

ADDRESS = 8
"""Bytes of an address, and of a counter with what aligns it."""

FRAME = 96
"""Bytes of a call: where it returns to, kept registers, alignment, what a root needs."""

MATHEMATICS = 640
"""Bytes that the largest function of ``<math.h>`` takes: a sine of a large angle."""

SIMPLE = {"sqrt", "fabs", "fmin", "fmax", "copysign", "floor", "ceil"}
"""Of ``<math.h>``, but without anything inside."""

KERNELS = {"cs_window": 2560}
"""Bytes that a kernel takes with all that it calls; they do not depend on its sizes."""

OF_MATRICES = 640
"""The same of all others."""


def stack_bytes(program: Program, kind: Precision) -> int:
    """Largest number of bytes with 64-bit addresses and without any optimisation."""
    inside = [_leaf(leaf, kind) for leaf in program.leaves]
    inside += [KERNELS.get(name, OF_MATRICES) for name in program.kernels]
    return _step(program, kind) + max(inside, default=0)


def _leaf(leaf: Leaf, kind: Precision) -> int:
    """Every number that is not a constant is a local variable."""
    numbers = sum(o.kind != "const" for o in leaf.operations)
    arguments = len(leaf.inputs) + len(leaf.outputs)
    calls = {o.kind for o in leaf.operations} & FUNCTIONS - SIMPLE
    return 2 * FRAME + kind.bytes * numbers + ADDRESS * arguments + MATHEMATICS * bool(calls)


def _step(program: Program, kind: Precision) -> int:
    """Arguments, local arrays, counters, numbers held while they are moved, lists for kernels."""
    total = FRAME + ADDRESS * len(program.interface) + kind.bytes * local_numbers(program)
    total += ADDRESS * len(local_buffers(program))  # each array is aligned
    for statement in program.statements:
        match statement:
            case Foreign(inputs=inputs, outputs=outputs):
                total += ADDRESS * (len(inputs) + len(outputs))
            case Copy(source=source, target=target):
                held = source.buffer == target.buffer and (source.strides or target.strides)
                total += ADDRESS + kind.bytes * source.size * bool(held)
            case Loop() | While():
                total += ADDRESS
            case _:  # what does not fit into registers is handed over in the frame of the step
                pass
    arguments = (len(leaf.inputs) + len(leaf.outputs) for leaf in program.leaves)
    return total + ADDRESS * max(arguments, default=0)
