"""The self-test that goes with exported C."""

import dataclasses

import numpy as np

from backsight.engine.c99 import Precision
from backsight.types import Array

COUNTS = ("status", "iterations", "passes", "steps", "nonzeros", "infeasible")
"""Outputs that are whole numbers."""

RESIDUALS = ("kkt", "gap")
"""Outputs that are zero but for rounding: in single precision they are as large as that rounds."""


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
    vectors: Vectors,
    name: str,
    kind: Precision,
    tolerance: float,
    *,
    settings: bool,
    begins: bool,
) -> str:
    """Write a program that runs the vectors and returns 0 if all outputs agree.

    The deviation of a number is measured in units of the largest value that it takes; in single
    precision that of an estimate in units of its smallest standard deviation. Counts and residuals
    are compared in double precision only: in single precision the optimiser may take another number
    of passes to the same result.

    With `settings` the step takes a struct of them, at its defaults here; with `begins` they set
    the memory before the first sample, too.
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
        k: v
        for k, v in vectors.outputs.items()
        if kind.name == "double" or k not in (*COUNTS, *RESIDUALS)
    }
    for k, v in compared.items():
        tables.append(_table(f"out_{k}", v, "double", Precision("double")))
        tables.append(_table(f"size_{k}", _sizes(k, vectors, kind), "double", Precision("double")))
    banded = _banded(vectors, kind)
    measures = ["smallest band" if k in banded else "largest value" for k in compared]
    checks = [
        f'    failed |= report("{k}", worst[{j}], "{measure}");'
        for j, (k, measure) in enumerate(zip(compared, measures, strict=True))
    ]
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
        "static int report(const char *what, double deviation, const char *measure)",
        "{",
        f"    const int failed = !(deviation <= {tolerance!r});",
        '    printf("%-12s deviation %.2e of its %s%s\\n", what, deviation, measure,',
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
        *([f"    {name}_defaults(&settings);"] if settings else []),
        f"    {name}_init(&memory{', &settings' if begins else ''});",
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


def _sizes(name: str, vectors: Vectors, kind: Precision) -> Array:
    """What deviations are measured by, for every column, see `selftest`; 1 where that is zero."""
    sizes = np.max(np.abs(vectors.outputs[name]), axis=0)
    if name in _banded(vectors, kind):
        n = vectors.outputs[name].shape[1]
        diagonal = [i * n - i * (i - 1) // 2 for i in range(n)]
        band = np.sqrt(np.maximum(vectors.outputs["P"][:, diagonal], 0.0).min(axis=0))
        # A state that is known exactly has no band.
        sizes = np.where(band > 0, band, sizes)
    return np.where(sizes > 0, sizes, 1.0)


def _banded(vectors: Vectors, kind: Precision) -> tuple[str, ...]:
    """Outputs whose deviation is measured by their standard deviation."""
    return ("x_hat",) if kind.name == "float" and {"x_hat", "P"} <= set(vectors.outputs) else ()


def _table(name: str, values: Array, real: str, kind: Precision) -> str:
    numbers = [kind.number(float(v)) for v in values.ravel()] or ["0"]
    rows = [", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    joint = ",\n    ".join(rows)
    return f"static const {real} {name}[{len(numbers)}] = {{\n    {joint}}};"
