"""Leaves as functions in LLVM's language, on single numbers or on vectors of lanes."""

from collections.abc import Iterable

from backsight.engine.llvm import _math as llvm_math
from backsight.engine.llvm.width import Width
from backsight.engine.program import Leaf, Operation

FLAGS = "reassoc nsz arcp contract"
"""Freedom of the compiler: reordering, reciprocals, fused multiply-add; NaN and infinity stay."""

INFIX = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "fmod": "frem"}
COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
INTRINSICS = {
    "sqrt": "sqrt", "fabs": "fabs", "floor": "floor", "ceil": "ceil", "copysign": "copysign",
    "fmin": "minnum", "fmax": "maxnum", "pow": "pow",
}  # fmt: skip
FUSED = ("fma", "fmuladd")
ARGUMENTS = {"minnum": 2, "maxnum": 2, "pow": 2, "copysign": 2, "fma": 3, "fmuladd": 3}
"""Of the intrinsic functions that take more than one."""

LIBRARY = {
    "tan": 1, "asin": 1, "acos": 1, "atan": 1, "atan2": 2, "sinh": 1, "cosh": 1,
    "asinh": 1, "acosh": 1, "atanh": 1, "erf": 1, "expm1": 1, "log1p": 1, "hypot": 2,
    "remainder": 2, "sin": 1, "cos": 1,
}  # fmt: skip
"""Functions of the C library, with their number of arguments; called for every lane."""


def declarations(leaves: Iterable[Leaf], width: Width) -> str:
    """Intrinsics and library functions that leaves may call, and elementary ones that these do."""
    t, used = width.number, {operation.kind for leaf in leaves for operation in leaf.operations}
    lines = [
        "declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)",
        "declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)",
    ]
    for name in sorted({*INTRINSICS.values(), *FUSED}):
        arguments = ", ".join([t] * ARGUMENTS.get(name, 1))
        lines.append(f"declare {t} @llvm.{name}.{width.suffix}({arguments})")
    for name, n in LIBRARY.items():
        lines.append(f"declare double @{name}({', '.join(['double'] * n)}) nounwind willreturn")
        if width.lanes > 1:
            lines.append(_each_lane(name, n, width))
    return "\n".join(
        [*lines, *(llvm_math.write_math(f, width) for f in llvm_math.FUNCTIONS if f in used)]
    )


def _each_lane(name: str, n: int, width: Width) -> str:
    t, rare = width.number, name in llvm_math.FUNCTIONS
    lines = [
        f"define internal {t} @lanes.{name}({', '.join(f'{t} %a{i}' for i in range(n))}) "
        f"{'cold noinline' if rare else 'alwaysinline'} nounwind {{"
    ]
    result = "poison"
    for k in range(width.lanes):
        for i in range(n):
            lines.append(f"  %x{k}_{i} = extractelement {t} %a{i}, i32 {k}")
        arguments = ", ".join(f"double %x{k}_{i}" for i in range(n))
        lines.append(f"  %y{k} = call double @{name}({arguments})")
        lines.append(f"  %r{k} = insertelement {t} {result}, double %y{k}, i32 {k}")
        result = f"%r{k}"
    return "\n".join([*lines, f"  ret {t} {result}", "}"])


def write_llvm_leaf(leaf: Leaf, width: Width, *, inline: bool) -> str:
    """Write a leaf as a function of pointers to its inputs and outputs.

    All inputs are read before an output is written, so that they may be the same memory.
    """
    t = width.number
    names = [f"%i{k}" for k in range(len(leaf.inputs))]
    names += [f"%o{k}" for k in range(len(leaf.outputs))]
    parameters = ", ".join(f"ptr {name}" for name in names)
    attributes = f"{'alwaysinline' if inline else 'noinline'} nounwind {width.attribute}"
    lines = [f"define internal void @leaf.{leaf.name}({parameters}) {attributes} {{"]
    values: list[str] = []
    for k, operation in enumerate(leaf.operations):
        added, value = _operation(operation, values, k, width)
        lines += added
        values.append(value)
    for j, output in enumerate(leaf.outputs):
        for i, k in enumerate(output):
            lines.append(f"  %p{j}_{i} = getelementptr inbounds {t}, ptr %o{j}, i64 {i}")
            lines.append(f"  store {t} {values[k]}, ptr %p{j}_{i}, align 8")
    return "\n".join([*lines, "  ret void", "}"])


def _operation(
    operation: Operation, values: list[str], k: int, width: Width
) -> tuple[list[str], str]:
    """Lines for one operation, and the name of its value."""
    t, kind, me = width.number, operation.kind, f"%v{k}"
    if kind == "const":
        return [], width.constant(operation.value)
    if kind == "input":
        i, offset = operation.arguments
        return [
            f"  %a{k} = getelementptr inbounds {t}, ptr %i{i}, i64 {offset}",
            f"  {me} = load {t}, ptr %a{k}, align 8",
        ], me
    x = [values[a] for a in operation.arguments]
    typed = [f"{t} {a}" for a in x]
    if kind in INFIX:
        return [f"  {me} = {INFIX[kind]} {FLAGS} {t} {x[0]}, {x[1]}"], me
    if kind == "neg":
        return [f"  {me} = fneg {FLAGS} {t} {x[0]}"], me
    if kind in INTRINSICS:
        name = f"@llvm.{INTRINSICS[kind]}.{width.suffix}"
        return [f"  {me} = call {FLAGS} {t} {name}({', '.join(typed)})"], me
    if kind in llvm_math.FUNCTIONS:
        return [f"  {me} = call {t} @math.{kind}({typed[0]})"], me
    if kind in LIBRARY:
        name = f"@{kind}" if width.lanes == 1 else f"@lanes.{kind}"
        return [f"  {me} = call {t} {name}({', '.join(typed)})"], me
    if kind in COMPARE:
        condition = f"  %c{k} = fcmp {COMPARE[kind]} {t} {x[0]}, {x[1]}"
        return [condition, _choose(k, width, 1.0, 0.0)], me
    if kind == "sign":
        return [
            f"  %n{k} = fcmp olt {t} {x[0]}, {width.constant(0.0)}",
            f"  %q{k} = fcmp ogt {t} {x[0]}, {width.constant(0.0)}",
            f"  %s{k} = select {width.truth} %q{k}, {t} {width.constant(1.0)}, {typed[0]}",
            f"  {me} = select {width.truth} %n{k}, {t} {width.constant(-1.0)}, {t} %s{k}",
        ], me
    tests = [f"  %t{k}_{i} = fcmp une {a}, {width.constant(0.0)}" for i, a in enumerate(typed[:2])]
    if kind == "select":
        return [tests[0], f"  {me} = select {width.truth} %t{k}_0, {typed[1]}, {typed[2]}"], me
    if kind == "not":
        return [*tests, f"  %c{k} = fcmp oeq {typed[0]}, {width.constant(0.0)}",
                _choose(k, width, 1.0, 0.0)], me  # fmt: skip
    joint = f"  %c{k} = {kind} {width.truth} %t{k}_0, %t{k}_1"
    return [*tests, joint, _choose(k, width, 1.0, 0.0)], me


def _choose(k: int, width: Width, then: float, otherwise: float) -> str:
    t = width.number
    values = f"{t} {width.constant(then)}, {t} {width.constant(otherwise)}"
    return f"  %v{k} = select {width.truth} %c{k}, {values}"
