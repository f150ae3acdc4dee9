"""Exported C as a sketch: a folder that the Arduino IDE opens and PlatformIO builds."""

import re
from pathlib import Path

from backsight.engine.c99 import source as c99
from backsight.errors import EngineError
from backsight.export._written import Written, one_line

MOST = 2**31 - 1
"""Microseconds between two samples: their counter has 32 bits."""


def sketch(code: Written, folder: Path) -> dict[str, str]:
    """What a folder needs beside the code to be a sketch; its name is that of the folder.

    Raises
    ------
    EngineError
        If the folder has no name that a sketch may have, or samples are too far apart or too close.
    """
    name = folder.absolute().name
    if not re.fullmatch(r"[A-Za-z0-9_][\w.-]*", name, re.ASCII):
        raise EngineError(f"a sketch cannot be called '{name}': use letters, digits, '_' and '-'")
    period = round(1e6 * code.recursion.dt)
    if not 1 <= period <= MOST:
        raise EngineError(f"a sketch takes a sample every {1e6 * code.recursion.dt:g} us at most")
    return {f"{name}.ino": _program(code, period), "platformio.ini": _CONFIGURATION}


_CONFIGURATION = """\
; `pio run`; other boards are other sections. `pio device monitor` shows the numbers.
[platformio]
src_dir = .

[env]
framework = arduino
monitor_speed = 115200
build_flags = -O2

[env:teensy41]
platform = teensy
board = teensy41

[env:nucleo_f446re]
platform = ststm32
board = nucleo_f446re
"""


def _program(code: Written, period: int) -> str:
    name, model = code.name, code.model
    real = f"{name}_real"
    sensors = [s for s in model.outputs if s.dummy is None]
    # A dummy is always "measured": the README says so, too.
    fixed = [(i, s) for i, s in enumerate(model.outputs) if s.dummy is not None]
    given = [f"    u[{i}] = 0; // {_of(s)}" for i, s in enumerate(model.inputs)]
    for i, s in enumerate(model.outputs):
        if s in sensors:
            given.append(f"    y[{i}] = 0; mask[{i}] = 0; // {_of(s)}: mask 1 where measured")
    given += [f"    y[{i}] = {s.dummy!r}; mask[{i}] = 1; // no sensor" for i, s in fixed]
    results = [c.name for c in code.recursion.channels]
    sizes = [f"static {real} {r}[{c99.size_of(name, r)}];" for r in results]
    settings = bool(code.open.fields)
    shown = [f'    Serial.print("{s.name} ");' for s in model.states]
    lines = [
        line
        for k, label in enumerate(shown)
        for line in (label, f"    Serial.print(x_hat[{k}], 6);", "    Serial.print(' ');")
    ]
    return "\n".join(
        [
            f"// {code.estimator.title} for '{one_line(model.name)}': a sample every {period} us.",
            "// Say in measure() what the sensors see; until then the model alone predicts.",
            'extern "C" {',
            f'#include "{name}.h"',
            "}",
            "",
            f"static const uint32_t PERIOD = {period}; // us",
            "",
            f"static {name}_memory memory;  // survives from sample to sample",
            f"static {name}_workspace work; // scratch",
            *([f"static {name}_settings settings;"] if settings else []),
            f"static {real} u[{max(model.nu, 1)}], y[{model.ny}], mask[{model.ny}];",
            *sizes,
            "static uint32_t due;",
            "",
            "// Known inputs and measurements of now, in the units of the model.",
            "static void measure()",
            "{",
            *given,
            "}",
            "",
            "void setup()",
            "{",
            "    Serial.begin(115200);",
            *([f"    {name}_defaults(&settings);"] if settings else []),
            f"    {name}_init(&memory{', &settings' if code.open.start else ''});",
            "    due = micros();",
            "}",
            "",
            "void loop()",
            "{",
            "    // The difference is right when the counter begins anew, too.",
            "    if ((int32_t)((uint32_t)micros() - due) < 0) return;",
            "    due += PERIOD;",
            "    measure();",
            f"    {name}_step(&memory, &work, {'&settings, ' if settings else ''}u, y, mask, "
            f"{', '.join(results)});",
            *lines,
            "    Serial.println(status[0], 0);",
            "}",
            "",
        ]
    )


def _of(signal: object) -> str:
    """A signal with its unit, as a comment in a line."""
    name, unit = getattr(signal, "name", ""), getattr(signal, "unit", "")
    return one_line(f"{name} [{unit}]" if unit else name).rstrip("\\")
