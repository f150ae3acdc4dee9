"""The documentation inside an FMU: ``documentation/index.html``, and its icon."""

import html
import struct
import zlib
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np

from backsight.export._written import Written, one_line
from backsight.export.fmi._variables import Variable
from backsight.schema import STATUS_TEXT

STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border-bottom:1px solid #ccc;padding:.2em .8em .2em 0;"
    "text-align:left;vertical-align:top}"
)

ICON = 64
"""Pixels along an edge."""


def page(code: Written, found: Sequence[Variable]) -> str:
    """What the FMU does, when, with which variables, and what its status means."""
    title = _safe(f"{code.estimator.title} for {code.model.name or code.name}")
    lag = code.recursion.lag
    looks_back = (
        f"<p>The estimator looks back: the outputs are about the sample {lag} steps earlier.</p>"
        if lag
        else ""
    )
    bits = "".join(
        f"<tr><td>{int(bit)}</td><td>{_safe(text)}</td></tr>" for bit, text in STATUS_TEXT.items()
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style></head>
<body>
<h1>{title}</h1>
<p>Estimates the states of the model from its known inputs <code>u</code> and the measurements
<code>y</code>, with 95 % bands.</p>
<h2>Timing</h2>
<p>One communication step is one sample, every {code.recursion.dt:g} s; other steps are refused. The
inputs that are set before the step from <i>t</i> to <i>t</i> + {code.recursion.dt:g} s are the
sample at <i>t</i>, and the outputs after the step are the estimate of that sample. A measurement
that is NaN, or whose mask is 0, was not made.</p>
<p>In scheduled execution a sample is a tick of the clock <code>sample</code>: the inputs that are
set before the partition is activated at <i>t</i> are the sample at <i>t</i>. The clock ticks from
the start on, every {code.recursion.dt:g} s; a tick at another time is refused.</p>
{looks_back}
<h2>Variables</h2>
{_table(found, "parameter", "Tunable parameters")}
{_table(found, "input", "Inputs")}
{_table(found, "output", "Outputs")}
<h2>Status</h2>
<p>The status is a sum of bits; 0 is nothing to report.</p>
<table><tr><th>bit</th><th>meaning</th></tr>{bits}</table>
<h2>State</h2>
<p>The state can be kept, set again and written down: going back gives the same results to the last
bit on the same platform.</p>
<p>Written by Backsight {_safe(version("backsight"))}.</p>
</body></html>
"""


def _table(found: Sequence[Variable], causality: str, title: str) -> str:
    rows = "".join(
        f"<tr><td><code>{_safe(v.name)}</code></td><td>{_safe(v.unit)}</td>"
        f"<td>{'' if v.causality == 'output' else f'{v.start:.6g}'}</td>"
        f"<td>{_safe(v.about)}</td></tr>"
        for v in found
        if v.causality == causality
    )
    if not rows:
        return ""
    head = "<tr><th>name</th><th>unit</th><th>start</th><th></th></tr>"
    return f"<h3>{title}</h3>\n<table>{head}{rows}</table>"


def icon() -> bytes:
    """A noisy curve and its estimate in a frame, as PNG."""
    x = np.arange(ICON)
    rows, columns = np.meshgrid(x, x, indexing="ij")
    curve = ICON / 2 - 0.3 * ICON * np.sin(2 * np.pi * columns / ICON)
    pixels = np.full((ICON, ICON, 3), 255, np.uint8)
    pixels[np.abs(rows - curve) < 9] = (207, 224, 243)
    pixels[np.abs(rows - curve) < 2] = (31, 95, 168)
    edge = (rows < 2) | (columns < 2) | (rows >= ICON - 2) | (columns >= ICON - 2)
    pixels[edge] = (60, 60, 60)
    lines = b"".join(b"\0" + line.tobytes() for line in pixels)
    header = struct.pack(">IIBBBBB", ICON, ICON, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(kind + data))
    return struct.pack(">I", len(data)) + kind + data + check


def _safe(text: str) -> str:
    return html.escape(one_line(text))
