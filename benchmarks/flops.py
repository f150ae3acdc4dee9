"""Arithmetic of a program, counted; and what the processor could do at most, measured."""

import ctypes
import dataclasses
from collections.abc import Iterable

import llvmlite.binding as llvm
import numpy as np

from backsight.engine.program import Call, Loop, Statement, While, walk
from backsight.engine.recursion import Recursion
from benchmarks.contest import clock

CHAINS = 16
"""Independent chains of multiply-adds, enough to hide their latency."""

PASSES = 20_000_000 // CHAINS


def count(recursion: Recursion) -> int:
    """Floating-point operations of one sample.

    Every operation that is not an input or a constant counts as one, comparisons, choices and
    hyperbolic tangents, too. A loop that ends by itself counts with its limit if that is a fixed
    number of Gauss-Newton iterations, and else once: an active set without active bounds is found
    in one pass.
    """
    return _count(walk(recursion.step).body)


def _count(statements: Iterable[Statement]) -> int:
    total = 0
    for statement in statements:
        match statement:
            case Call(leaf=leaf):
                total += sum(o.kind not in ("input", "const") for o in leaf.operations)
            case Loop(length=length, body=body):
                total += length * _count(body)
            case While(flag=flag, limit=limit, body=body):
                fixed = flag.buffer.name.startswith("gauss_newton")
                total += (limit if fixed else 1) * _count(body)
    return total


@dataclasses.dataclass(frozen=True)
class Peak:
    """Largest speed of one core [GFlop/s]: single numbers, and vectors of 8."""

    scalar: float
    vector: float


def peak() -> Peak:
    """Measure multiply-adds (two operations each) that wait for nothing."""
    return Peak(*(_speed(lanes) for lanes in (1, 8)))


def _speed(lanes: int) -> float:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=2
    )
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(_kernel(lanes)), target)
    engine.finalize_object()
    run = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)(
        engine.get_function_address("run")
    )
    # Chains and multiplier stay near one, so that nothing overflows or becomes subnormal.
    numbers = np.ones((CHAINS + 2) * lanes)
    numbers[CHAINS * lanes : (CHAINS + 1) * lanes] = 1 - 1e-12
    numbers[(CHAINS + 1) * lanes :] = 1e-12
    seconds = min(clock(lambda: run(PASSES, numbers.ctypes.data))[0] for _ in range(10))
    return 2e-9 * CHAINS * lanes * PASSES / seconds


def _kernel(lanes: int) -> str:
    kind = "double" if lanes == 1 else f"<{lanes} x double>"
    suffix = "f64" if lanes == 1 else f"v{lanes}f64"
    fma = f"@llvm.fma.{suffix}"
    places = [
        f"%p{i} = getelementptr {kind}, ptr %data, i64 {i}\n%v{i} = load {kind}, ptr %p{i}, align 8"
        for i in range(CHAINS + 2)
    ]
    phis = [f"%a{i} = phi {kind} [%v{i}, %entry], [%b{i}, %loop]" for i in range(CHAINS)]
    steps = [
        f"%b{i} = call {kind} {fma}({kind} %a{i}, {kind} %v{CHAINS}, {kind} %v{CHAINS + 1})"
        for i in range(CHAINS)
    ]
    stores = [f"store {kind} %b{i}, ptr %p{i}, align 8" for i in range(CHAINS)]
    return "\n".join(
        [
            f"declare {kind} {fma}({kind}, {kind}, {kind})",
            f'define void @run(i64 %n, ptr %data) "min-legal-vector-width"="{64 * lanes}" {{',
            "entry:",
            *places,
            "br label %loop",
            "loop:",
            "%k = phi i64 [0, %entry], [%next, %loop]",
            *phis,
            *steps,
            "%next = add i64 %k, 1",
            "%more = icmp slt i64 %next, %n",
            "br i1 %more, label %loop, label %done",
            "done:",
            *stores,
            "ret void",
            "}",
        ]
    )
