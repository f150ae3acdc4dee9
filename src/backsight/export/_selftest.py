"""The self-test that goes with exported C."""

import dataclasses

import numpy as np

from backsight.engine.c99 import Precision
from backsight.types import Array

COUNTS = ("status", "iterations")
"""Outputs that are whole numbers."""


@dataclasses.dataclass(frozen=True)
class Vectors:
    """What goes in and what must come out, one row per sample.

    Parameters
    ----------
    inputs, outputs : dict of (n, m) arrays
    """

    inputs: dict[str, Array]
    outputs: dict[str, Array]


def selftest(
    vectors: Vectors, name: str, kind: Precision, tolerance: float, *, settings: bool
) -> str:
    """Write a program that runs the vectors and returns 0 if all outputs agree.

    The deviation of a number is measured in units of the largest value that it takes. Counts are
    compared in double precision only: in single precision the
    optimiser may take another number of passes to the same result.

    With `settings` the step takes a struct of them, at its defaults here.
    """
    n = len(next(iter(vectors.outputs.values())))
    real = f"{name}_real"
    tables = [_table(f"in_{k}", v, real, kind) for k, v in vectors.inputs.items()]
    local = [f"    {real} {k}[{max(v.shape[1], 1)}];" for k, v in vectors.outputs.items()]
    arguments = ", ".join(
        [f"in_{k} + k * {v.shape[1]}" for k, v in vectors.inputs.items()] + list(vectors.outputs)
    )
    given = "&memory, &work" + ", &settings" * settings
    compared = {
        k: v for k, v in vectors.outputs.items() if kind.name == "double" or k not in COUNTS
    }
    for k, v in compared.items():
        tables.append(_table(f"out_{k}", v, "double", Precision("double")))
        tables.append(_table(f"size_{k}", _sizes(v), "double", Precision("double")))
    checks = [f'    failed |= report("{k}", worst[{j}]);' for j, k in enumerate(compared)]
    compares = [
        f"        compare({k}, out_{k} + k * {v.shape[1]}, size_{k}, {v.shape[1]}, worst + {j});"
        for j, (k, v) in enumerate(compared.items())
    ]
    lines = [
        f"/* Compares {name}.c with Python on {n} samples of a recording. */",
        "#include <math.h>",
        "#include <stdio.h>",
        "",
        f'#include "{name}.h"',
        "",
        *tables,
        "",
        "static void compare(",
        f"    const {real} *got, const double *want, const double *size, int n, double *worst)",
        "{",
        "    int i;",
        "    for (i = 0; i < n; ++i) {",
        "        const double deviation = fabs((double)got[i] - want[i]) / size[i];",
        "        if (!(deviation <= *worst))",
        "            *worst = deviation;",
        "    }",
        "}",
        "",
        "static int report(const char *what, double deviation)",
        "{",
        f"    const int failed = !(deviation <= {tolerance!r});",
        '    printf("%-12s deviation %.2e of its largest value%s\\n", what, deviation,',
        '           failed ? "  FAILED" : "");',
        "    return failed;",
        "}",
        "",
        "int main(void)",
        "{",
        f"    static {name}_memory memory;",
        f"    static {name}_workspace work;",
        *([f"    {name}_settings settings;"] if settings else []),
        *local,
        f"    double worst[{len(compared)}] = {{0.0}};",
        "    int k, failed = 0;",
        f"    {name}_init(&memory);",
        *([f"    {name}_defaults(&settings);"] if settings else []),
        f"    for (k = 0; k < {n}; ++k) {{",
        f"        {name}_step({given}, {arguments});",
        *compares,
        "    }",
        *checks,
        f'    printf("%s: {n} samples %s\\n", "{name}", failed ? "FAILED" : "passed");',
        "    return failed;",
        "}",
        "",
    ]
    return "\n".join(lines)


def _sizes(values: Array) -> Array:
    """Largest value of every column, 1 where it is zero throughout."""
    largest = np.max(np.abs(values), axis=0)
    return np.where(largest > 0, largest, 1.0)


def _table(name: str, values: Array, real: str, kind: Precision) -> str:
    numbers = [kind.number(float(v)) for v in values.ravel()] or ["0"]
    rows = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    joint = ",\n    ".join(rows)
    return f"static const {real} {name}[{len(numbers)}] = {{\n    {joint}}};"
