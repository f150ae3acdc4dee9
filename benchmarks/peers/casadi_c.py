"""CasADi's own generated C of the same recursion, compiled by gcc."""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np

from backsight.engine.recursion import Recursion
from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.problems import Problem

FAST = [
    "-march=native",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fassociative-math",
    "-freciprocal-math",
]
"""What our own code generator allows, too: NaN and infinity are kept."""

LOOP = """
int {name}(const double **arg, double **res, long long *iw, double *w, int mem);
void run(long long n, const double **arg, double **res, long long *iw, double *w,
         double *a, double *b, const double *u, const double *y, const double *m,
         double *x, double **rest) {{
  for (long long k = 0; k < n; ++k) {{
    arg[0] = k % 2 ? b : a; arg[1] = u + k * {nu}; arg[2] = y + k * {ny}; arg[3] = m + k * {ny};
    res[0] = k % 2 ? a : b; res[1] = x + k * {nx};
    for (int i = 2; i < {outputs}; ++i) res[i] = rest[i - 2];
    {name}(arg, res, iw, w, 0);
  }}
}}
"""
"""The loop over the recording, so that no call from Python is counted."""


def by_buffer(problem: Problem, flags: list[str]) -> Contender:
    """One call from Python per sample through the buffer interface."""
    recursion = problem.recursion
    step, _ = _loaded(recursion, flags)
    u, y, mask = problem.data
    here = [np.empty(m) for m in recursion.input_sizes]
    memory = [np.empty(len(recursion.carry0)) for _ in range(2)]
    results = [np.empty(m) for m in recursion.output_sizes]
    # Two calls in turns, so that the new memory becomes the old one without a copy.
    calls = []
    for one, other in (memory, memory[::-1]):
        buffer, call = step.buffer()
        for i, array in enumerate((one, *here)):
            buffer.set_arg(i, memoryview(array))
        for i, array in enumerate((other, *results)):
            buffer.set_res(i, memoryview(array))
        calls.append((buffer, call))
    x_hat = np.empty((len(u), recursion.output_sizes[0]))

    def work() -> Array:
        memory[0][:] = recursion.carry0
        for k in range(len(u)):
            for array, rows in zip(here, (u, y, mask), strict=True):
                array[:] = rows[k]
            calls[k % 2][1]()
            x_hat[k] = results[0]
        return x_hat / problem.setting.sx

    return Contender(work, len(u), expected(problem))


def in_c(problem: Problem, flags: list[str]) -> Contender:
    """One call from Python for the whole recording; the loop is in C."""
    recursion = problem.recursion
    _, library = _loaded(recursion, flags)
    # The generated code needs other amounts of working memory than the virtual machine.
    sizes = [ctypes.c_longlong() for _ in range(4)]
    library[f"{recursion.name}_work"](*(ctypes.byref(size) for size in sizes))
    working = [np.empty(max(size.value, 1)) for size in sizes]
    memory = [recursion.carry0.copy(), recursion.carry0.copy()]
    data = [np.ascontiguousarray(d) for d in problem.data]
    x_hat = np.empty((len(data[0]), recursion.output_sizes[0]))
    rest = [np.empty(size) for size in recursion.output_sizes[1:]]
    arrays = [*working, *memory, *data, x_hat]

    def work() -> Array:
        memory[0][:] = recursion.carry0
        library.run(ctypes.c_longlong(len(x_hat)), *map(_address, arrays), _addresses(rest))
        return x_hat / problem.setting.sx

    return Contender(work, len(x_hat), expected(problem))


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _addresses(arrays: list[Array]) -> "ctypes.Array[ctypes.c_void_p]":
    return (ctypes.c_void_p * len(arrays))(*map(_address, arrays))


def _loaded(recursion: Recursion, flags: list[str]) -> tuple[ca.Function, ctypes.CDLL]:
    """Write C, compile it, and load it: as CasADi does, and as a library with the loop."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise FileNotFoundError("there is no gcc on this machine")
    step = recursion.step
    loop = LOOP.format(
        name=step.name(),
        outputs=step.n_out(),
        nu=step.numel_in(1),
        ny=step.numel_in(2),
        nx=step.numel_out(1),
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        generator = ca.CodeGenerator("step.c")
        generator.add(step)
        generator.generate(f"{folder}/")
        (folder / "loop.c").write_text(loop, encoding="utf-8")
        library = str(folder / "step.so")
        sources = [str(folder / source) for source in ("step.c", "loop.c")]
        subprocess.run(
            [compiler, "-O3", "-fPIC", "-shared", *flags, *sources, "-o", library, "-lm"],
            check=True,
            capture_output=True,
        )
        # A loaded library stays when its file goes.
        return ca.external(step.name(), library), ctypes.CDLL(library)
