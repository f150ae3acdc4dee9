"""An estimator as C99 for a controller, with a test that runs there."""

import os
import re
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from backsight.description import checked
from backsight.engine import vm
from backsight.engine.c99 import Precision
from backsight.engine.c99 import source as c99
from backsight.engine.program import While, flat, walk
from backsight.engine.recursion import Recursion
from backsight.errors import DataError, EngineError, printable
from backsight.estimators.base import AbstractEstimator
from backsight.export._selftest import Vectors, selftest
from backsight.kernels import sources
from backsight.models.model import Model
from backsight.output import whole
from backsight.run.estimation import match
from backsight.types import Array

SAMPLES = 200
"""Samples of the recording that the self-test runs through."""

SINGLE = """In single precision no step of an optimiser is as short as 1e-6 standard deviations:
export it with `tolerance = 1e-3`, or with a fixed number of iterations.

"""

INT = 4
"""Bytes of an int on most controllers."""

TOLERANCE = {"double": 1e-10, "float": 1e-2}
"""Largest deviation from Python, relative to the largest value of the output."""


@checked(EngineError)
def export_c(
    estimator: AbstractEstimator,
    model: Model,
    recording: xr.Dataset,
    out: str | os.PathLike[str],
    *,
    name: str = "estimator",
    precision: Literal["double", "float"] = "double",
    restart: bool = False,
    force: bool = False,
) -> Path:
    """Write ``name.c``, ``name.h``, a self-test, a Makefile and a README.

    The code is C99 that needs nothing but ``<math.h>``: no allocation, no recursion, no global
    variables, and loops whose largest number of passes is fixed. The self-test compares it with
    Python on the first samples of the recording.

    Parameters
    ----------
    estimator : AbstractEstimator
    model : Model
    recording : xarray.Dataset
        Gives the sampling period and the data of the self-test.
    out : path
        Folder.
    name : str
        Prefix of files, types and functions.
    precision : {"double", "float"}
        Type of all numbers. In ``float`` an estimator with a wide range of covariances may lose
        accuracy; the self-test says how much.
    restart : bool
        After a sample whose estimate is not finite start anew from the prior; the status of that
        sample says so.
    force : bool
        Replace files of the same names in the folder that are not from an earlier export.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    EngineError
        If the name is no identifier or the estimator cannot be written in C.
    DataError
        If the recording does not fit the model or the self-test would not be finite.
    OutputError
        If the folder cannot be written, or holds files of the same names that are not from an
        earlier export.

    Examples
    --------
    >>> spring = bs.sdof(k=40.0, b=0.8)
    >>> recording = bs.simulate(spring, [[1.0]] * 20, dt=0.05, sigma_y=1e-3, seed=1)
    >>> kf = bs.KalmanFilter(bs.Noise(sigma_y=1e-3, sigma_w=1e-5), bs.Prior(sigma_x0=1.0))
    >>> folder = bs.export.export_c(kf, spring, recording, "code", name="kf")
    >>> sorted(path.name for path in folder.glob("*.[ch]"))
    ['kf.c', 'kf.h', 'kf_selftest.c']
    """
    if not (name.isidentifier() and name.isascii()):
        raise EngineError(f"'{name}' is no name in C: use letters, digits and underscores")
    if name in ("kernels", *sources.names()):
        raise EngineError(f"'{name}' is the name of a file of the export: choose another one")
    kind = Precision(precision)
    recursion = estimator.compile(model, float(recording.attrs["dt"]))
    recursion = recursion.restarting() if restart else recursion
    program = walk(recursion.step)
    source = c99.write_c99(
        program,
        name=name,
        start=recursion.carry0.tolist(),
        results=[c.name for c in recursion.channels],
        precision=kind,
        about=f"{estimator.title} for '{_line(model.name)}', every {recursion.dt:g} s.\n"
        f"Written by Backsight {version('backsight')}; change the model, not this file.",
    )
    data = [d[:SAMPLES] for d in match(model, recording, estimator=estimator)]
    vectors = _vectors(recursion, data)
    passes = [s.limit for s in flat(program.body) if isinstance(s, While)]
    kernels = sources.files(source.kernels) if source.kernels else []
    files = {
        f"{name}.h": source.header,
        f"{name}.c": source.code,
        f"{name}_selftest.c": selftest(vectors, name, kind, TOLERANCE[precision]),
        "Makefile": _makefile(name, [f.name for f in kernels]),
        **{f.name: f.read_text(encoding="utf-8") for f in kernels},
        "README.md": _readme(source, name, kind, passes, recursion, model),
    }
    with whole(out, names=files, force=force) as folder:
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
    return Path(out)


def _vectors(recursion: Recursion, data: list[Array]) -> Vectors:
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    for channel, values in zip(recursion.channels, outputs, strict=True):
        if not np.all(np.isfinite(values)):
            raise DataError(
                f"'{channel.name}' is not finite within the first {len(values)} samples, so that "
                "there is nothing to test against; run the estimator on the recording first"
            )
    names = ("u", "y", "mask")
    return Vectors(
        inputs=dict(zip(names, data, strict=True)),
        outputs={c.name: o for c, o in zip(recursion.channels, outputs, strict=True)},
    )


def _line(text: str) -> str:
    return printable(" ".join(text.split()))


def _markdown(text: str) -> str:
    """Text that Markdown shows as it is."""
    return re.sub(r"([\\`*_{}\[\]<>()#+!|~$&-])", r"\\\1", _line(text))


def _makefile(name: str, kernels: list[str]) -> str:
    needed = " ".join([f"{name}.c", f"{name}_selftest.c", f"{name}.h", *kernels])
    return f"""CC ?= cc
CFLAGS ?= -std=c99 -pedantic -Wall -Wextra -Werror -O2

test: {name}_selftest
\t./{name}_selftest

{name}_selftest: {needed}
\t$(CC) $(CFLAGS) -o $@ {name}.c {name}_selftest.c -lm

clean:
\trm -f {name}_selftest

.PHONY: test clean
"""


def _of_virtual(model: Model) -> str:
    if model.virtual is None:
        return ""
    names = [f"{s.name} [{_markdown(s.unit)}]" if s.unit else s.name for s in model.virtual.signals]
    return f"| z_hat, z_std | {', '.join(names)} |\n"


def _readme(
    source: c99.Source,
    name: str,
    kind: Precision,
    passes: list[int],
    recursion: Recursion,
    model: Model,
) -> str:
    # A multiplication with its operands takes a dozen bytes on common processors.
    flash = 1.5 * kind.bytes * source.operations / 1000
    states = ", ".join(
        f"{s.name} [{_markdown(s.unit)}]" if s.unit else s.name for s in model.states
    )
    inputs = ", ".join(s.name for s in model.inputs) or "none"
    outputs = ", ".join(
        s.name if s.dummy is None else f"{s.name} (no sensor: y = {s.dummy:g}, mask = 1)"
        for s in model.outputs
    )
    workspace = kind.bytes * source.workspace + INT * source.ints
    needed = sources.files(source.kernels)[1:] if source.kernels else []
    files = ", ".join(f"`{file.name}`" for file in needed)
    without = " without the kernels" if files else ""
    included = f", `kernels.h` and {files}, which `{name}.c` includes" if files else ""
    limits = ", ".join(map(str, passes)) or "none: every sample takes the same time"
    return f"""# {name}

`{name}.c` and `{name}.h` estimate the states {states}, every {recursion.dt:g} s. They are C99 and
need nothing but `<math.h>`{included}. `make test` compiles them with all
warnings as errors and compares them with Python on the first samples of your recording.

```c
static {name}_memory memory;        /* survives from sample to sample */
static {name}_workspace work;       /* scratch; may be shared with others between two calls */

{name}_init(&memory);
for (;;) {{
    /* physical units; mask is 1 where y was measured, else 0; it is 1 / sigma_factor
       if the estimator takes the noise of single samples into account */
    {name}_step(&memory, &work, u, y, mask, ...);
}}
```

| | |
|---|---|
| u | {inputs} |
| y, mask | {outputs} |
{_of_virtual(model)}| numbers | {kind.name}, {kind.bytes} bytes |
| RAM | {kind.bytes * source.memory} bytes memory, {workspace} bytes workspace |
| flash | about {flash:.0f} kB{without}; `size` of the object file tells exactly |
| largest number of passes of the loops inside each other | {limits} |

{SINGLE if kind.name == "float" else ""}There is no allocation, no recursion and no global variable;
several instances may run side by side, each with its own memory.
"""
