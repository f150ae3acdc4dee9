"""The page that goes with exported C."""

import re

from backsight.engine.c99 import source as c99
from backsight.engine.c99.stack import stack_bytes
from backsight.engine.program.effort import Effort, effort
from backsight.export._written import Written, one_line
from backsight.models.model import Model

SINGLE = """In single precision no step of an optimiser is as short as 1e-6 standard deviations:
export it with `tolerance = 1e-3`, or with a fixed number of iterations.

"""

TESTED = """`make test` compiles them with all
warnings as errors and compares them with Python on the first samples of your recording."""

SKETCH = """The folder is a sketch:
open it in the Arduino IDE, or build it with `pio run`."""

INT = 4
"""Bytes of an int on most controllers."""


def markdown(text: str) -> str:
    """Text that Markdown shows as it is."""
    return re.sub(r"([\\`*_{}\[\]<>()#+!|~$&-])", r"\\\1", one_line(text))


def readme(code: Written, *, tested: bool = True) -> str:
    """How to use it, how much memory it takes, and how much a step may cost."""
    source, name, kind = code.source, code.name, code.kind
    recursion, model, passes = code.recursion, code.model, code.passes
    # A multiplication with its operands takes a dozen bytes on common processors.
    flash = 1.5 * kind.bytes * source.operations / 1000
    states = ", ".join(f"{s.name} [{markdown(s.unit)}]" if s.unit else s.name for s in model.states)
    inputs = ", ".join(s.name for s in model.inputs) or "none"
    outputs = ", ".join(
        s.name if s.dummy is None else f"{s.name} (no sensor: y = {s.dummy:g}, mask = 1)"
        for s in model.outputs
    )
    # What comes after integers is aligned like the numbers before them.
    workspace = kind.bytes * (source.workspace + -(-INT * source.ints // kind.bytes))
    stack = stack_bytes(code.program, kind)
    files = ", ".join(f"`{file}`" for file in code.kernels if file != "kernels.h")
    without = " without the kernels" if files else ""
    single = SINGLE if kind.name == "float" else ""
    included = f", `kernels.h` and {files}, which `{name}.c` includes" if files else ""
    limits = ", ".join(map(str, passes)) or "none: every sample takes the same time"
    most = effort(code.program)
    results = [c.name for c in recursion.channels]
    arrays = "\n".join(f"{kind.name} {r}[{c99.size_of(name, r)}];" for r in results)
    settings = "&settings, " if code.open.fields else ""
    return f"""# {name}

`{name}.c` and `{name}.h` estimate the states {states}, every {recursion.dt:g} s. They are C99 and
need nothing but `<math.h>`{included}. {TESTED if tested else SKETCH}

```c
static {name}_memory memory;        /* survives from sample to sample */
static {name}_workspace work;       /* scratch; may be shared with others between two calls */
{"static " + name + "_settings settings;" if code.open.fields else ""}
{name + "_defaults(&settings);" if code.open.fields else ""}
{name}_init(&memory{", &settings" if code.open.start else ""});
{arrays}
for (;;) {{
    /* physical units; mask is 1 where y was measured, else 0; it is 1 / sigma_factor
       if the estimator takes the noise of single samples into account */
    {name}_step(&memory, &work, {settings}u, y, mask, {", ".join(results)});
}}
```

{_settings(code)}| | |
|---|---|
| u | {inputs} |
| y, mask | {outputs} |
{_of_virtual(model)}| numbers | {kind.name}, {kind.bytes} bytes |
| RAM | {kind.bytes * source.memory} bytes memory, {workspace} bytes workspace |
| stack | at most {stack} bytes with 64-bit addresses and no optimisation, far less with it |
| flash | about {flash:.0f} kB{without}; `size` of the object file tells exactly |
| largest number of passes of the loops inside each other | {limits} |
| additions, multiplications, comparisons per step | at most {most.plain} |
| divisions, square roots | at most {most.divisions}, {most.roots} |
| other functions of `<math.h>` | at most {most.functions} |
| numbers moved | at most {most.copies} |
{_of_others(most)}{single}There is no allocation, no recursion and no global variable;
several instances may run side by side, each with its own memory.
"""


def _of_others(most: Effort) -> str:
    """What is said of kernels from elsewhere, whose operations are not among those counted."""
    return f"| calls that are not counted | {most.uncounted} |\n\n" if most.uncounted else "\n"


def _of_virtual(model: Model) -> str:
    if model.virtual is None:
        return ""
    names = [f"{s.name} [{markdown(s.unit)}]" if s.unit else s.name for s in model.virtual.signals]
    return f"| z_hat, z_std | {', '.join(names)} |\n"


def _settings(code: Written) -> str:
    """What may be changed on the controller."""
    if not code.open.fields:
        return ""
    rows = [
        f"| `settings.{field.name}[{i}]` | {markdown(label)} | {value:.6g} |"
        for field in code.open.fields
        for i, (label, value) in enumerate(zip(field.labels, field.values, strict=True))
    ]
    return "\n".join(
        [
            "The settings may be changed between two samples, without a new export. Standard",
            "deviations must be larger than 0."
            + (
                " The prior is that of the settings when the memory is set."
                if code.open.start
                else ""
            ),
            "",
            "| setting | of | as exported |",
            "|---|---|---|",
            *rows,
            "",
            "",
        ]
    )
