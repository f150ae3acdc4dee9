"""Leaves and numbers in C99."""

import dataclasses
import math
from typing import Annotated, ClassVar, Literal

from backsight.description import Called, Description
from backsight.engine.program import Leaf, Operation
from backsight.errors import BacksightError, EngineError

INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
LOGIC = {"and": "&&", "or": "||"}
FUNCTIONS = {
    "sqrt", "fabs", "floor", "ceil", "exp", "log", "expm1", "log1p", "pow", "hypot", "sin", "cos",
    "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "erf", "fmin", "fmax", "fmod", "remainder", "copysign",
}  # fmt: skip
"""Functions of <math.h>, by the same name."""


@dataclasses.dataclass(frozen=True)
class Precision(Description):
    """Type of all numbers.

    Parameters
    ----------
    name : {"double", "float"}
    """

    refusal: ClassVar[type[BacksightError]] = EngineError

    name: Annotated[Literal["double", "float"], Called("precision")]

    @property
    def bytes(self) -> int:
        """Size of a number."""
        return 8 if self.name == "double" else 4

    @property
    def suffix(self) -> str:
        """End of function names and constants."""
        return "" if self.name == "double" else "f"

    def number(self, value: float) -> str:
        """Write a constant."""
        wide = "(double)" if self.name == "double" else ""  # INFINITY and NAN are floats
        if math.isnan(value):
            return f"{wide}NAN"
        if math.isinf(value) or (self.name == "float" and abs(value) > 3.4e38):
            return f"{wide}INFINITY" if value > 0 else f"(-{wide}INFINITY)"
        digits = repr(float(value)) if self.name == "double" else f"{value:.9g}"
        text = digits if any(c in digits for c in ".e") else f"{digits}.0"
        return f"({text}{self.suffix})" if value < 0 else text + self.suffix


def write_c99_leaf(leaf: Leaf, real: str, kind: Precision) -> str:
    """Write a leaf as a function; its inputs are read before its outputs are written."""
    names = [identifier(name) for name in leaf.names]
    inputs, outputs = names[: len(leaf.inputs)], names[len(leaf.inputs) :]
    parameters = [*(f"const {real} *{i}" for i in inputs), *(f"{real} *{o}" for o in outputs)]
    used = {o.arguments[0] for o in leaf.operations if o.kind == "input"}
    lines = [f"    (void){name};" for k, name in enumerate(inputs) if k not in used]
    filled = zip(outputs, leaf.outputs, strict=True)
    lines += [f"    (void){name};" for name, output in filled if not output]
    values: list[str] = []
    for k, operation in enumerate(leaf.operations):
        expression = _expression(operation, inputs, values, kind)
        if operation.kind == "const":
            values.append(expression)
            continue
        lines.append(f"    const {real} v{k} = {expression};")
        values.append(f"v{k}")
    for name, output in zip(outputs, leaf.outputs, strict=True):
        lines += [f"    {name}[{i}] = {values[k]};" for i, k in enumerate(output)]
    head = f"static void {identifier(leaf.name)}(\n    {', '.join(parameters)})"
    return "\n".join([head, "{", *lines, "}"])


def _expression(operation: Operation, inputs: list[str], values: list[str], kind: Precision) -> str:
    what = operation.kind
    if what == "const":
        return kind.number(operation.value)
    if what == "input":
        argument, number = operation.arguments
        return f"{inputs[argument]}[{number}]"
    x = [values[a] for a in operation.arguments]
    zero, one = kind.number(0.0), kind.number(1.0)
    if what in INFIX:
        return f"{x[0]} {INFIX[what]} {x[1]}"
    if what == "neg":
        return f"-{x[0]}"
    if what in FUNCTIONS:
        return f"{what}{kind.suffix}({', '.join(x)})"
    if what == "select":
        return f"({x[0]} != {zero}) ? {x[1]} : {x[2]}"
    if what == "sign":
        return f"({x[0]} > {zero}) ? {one} : (({x[0]} < {zero}) ? -{one} : {x[0]})"
    if what == "not":
        return f"({x[0]} == {zero}) ? {one} : {zero}"
    if what in COMPARE:
        return f"({x[0]} {COMPARE[what]} {x[1]}) ? {one} : {zero}"
    if what in LOGIC:
        return f"(({x[0]} != {zero}) {LOGIC[what]} ({x[1]} != {zero})) ? {one} : {zero}"
    raise EngineError(f"the operation '{what}' cannot be written in C")


def identifier(name: str) -> str:
    """A name that is no word of C and no function of its library."""
    return f"{name}_"
