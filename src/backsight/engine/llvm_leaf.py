"""Leaves as functions in LLVM's language, on single numbers or on vectors of lanes."""

import dataclasses
import struct

from backsight.engine.leaf import Leaf, Operation

FLAGS = "reassoc nsz arcp contract"
"""Freedom of the compiler: reordering, reciprocals, fused multiply-add; NaN and infinity stay."""

INFIX = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "fmod": "frem"}
COMPARE = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
INTRINSICS = {
    "sqrt": "sqrt", "fabs": "fabs", "floor": "floor", "ceil": "ceil", "copysign": "copysign",
    "fmin": "minnum", "fmax": "maxnum", "pow": "pow", "exp": "exp", "log": "log",
    "sin": "sin", "cos": "cos",
}  # fmt: skip
LIBRARY = {
    "tan": 1, "asin": 1, "acos": 1, "atan": 1, "atan2": 2, "sinh": 1, "cosh": 1, "tanh": 1,
    "asinh": 1, "acosh": 1, "atanh": 1, "erf": 1, "expm1": 1, "log1p": 1, "hypot": 2,
    "remainder": 2,
}  # fmt: skip
"""Functions of the C library, with their number of arguments; called for every lane."""


@dataclasses.dataclass(frozen=True)
class Width:
    """Number of lanes, and what follows from it.

    Parameters
    ----------
    lanes : int
    """

    lanes: int = 1

    @property
    def number(self) -> str:
        """Type of a number."""
        return "double" if self.lanes == 1 else f"<{self.lanes} x double>"

    @property
    def truth(self) -> str:
        """Type of a condition."""
        return "i1" if self.lanes == 1 else f"<{self.lanes} x i1>"

    @property
    def suffix(self) -> str:
        """Type as part of the name of an intrinsic function."""
        return "f64" if self.lanes == 1 else f"v{self.lanes}f64"

    @property
    def attribute(self) -> str:
        """Attribute of functions, without which some processors cut wide vectors in two."""
        return f'"min-legal-vector-width"="{64 * self.lanes}"'

    def constant(self, value: float) -> str:
        """Write a number, the same in all lanes."""
        text = f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"
        if self.lanes == 1:
            return text
        return "<" + ", ".join([f"double {text}"] * self.lanes) + ">"


def declarations(width: Width) -> str:
    """Intrinsics and library functions that leaves may call."""
    t = width.number
    lines = ["declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)"]
    for name in sorted(set(INTRINSICS.values())):
        arguments = ", ".join([t] * (2 if name in ("minnum", "maxnum", "pow", "copysign") else 1))
        lines.append(f"declare {t} @llvm.{name}.{width.suffix}({arguments})")
    for name, n in LIBRARY.items():
        lines.append(f"declare double @{name}({', '.join(['double'] * n)}) nounwind willreturn")
        if width.lanes > 1:
            lines.append(_each_lane(name, n, width))
    return "\n".join(lines)


def _each_lane(name: str, n: int, width: Width) -> str:
    t = width.number
    lines = [
        f"define internal {t} @lanes.{name}({', '.join(f'{t} %a{i}' for i in range(n))}) "
        "alwaysinline nounwind {"
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


def write_leaf(leaf: Leaf, width: Width, *, inline: bool) -> str:
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
