"""Run a recursion as machine code."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import casadi as ca
import llvmlite
import numpy as np

from backsight.engine import _cache as cache
from backsight.engine.building import built_alone
from backsight.engine.llvm import machine
from backsight.engine.llvm import module as llvm
from backsight.engine.llvm.foreign import kernel_symbol
from backsight.engine.llvm.width import Width
from backsight.engine.program import walk
from backsight.engine.recursion import Recursion
from backsight.errors import EngineError
from backsight.kernels import library, sources
from backsight.types import Array

BLOCK_SECONDS = 0.05
"""Time after which a run looks up: for an interrupt, and to tell its progress."""

FIRST_BLOCK = 16
"""Samples in the first block, from which the time per sample is learnt."""


@dataclasses.dataclass(frozen=True)
class Compiled:
    """A recursion as machine code.

    Parameters
    ----------
    code : Code
    given : tuple of int
        Sizes of the working buffers that the caller provides.
    lanes : int
        Recordings that advance together.
    tables : tuple of arrays
        Large constants, which the caller provides behind these.
    """

    code: machine.Code
    given: tuple[int, ...]
    lanes: int
    tables: tuple[Array, ...] = ()

    def workspace(self) -> list[Array]:
        """Return new working buffers, and the tables."""
        return [*(np.empty(size * self.lanes) for size in self.given), *self.tables]


def compiled(recursion: Recursion, *, lanes: int = 1) -> Compiled:
    """Compile a recursion, or take it from memory or disk.

    Raises
    ------
    EngineError
        If the recursion contains something that cannot be compiled.
    """
    return _compiled(recursion.step, lanes)


def run(
    recursion: Recursion,
    data: Sequence[Array],
    *,
    carry: Array,
    progress: Callable[[int], None] = lambda _: None,
    block: int | None = None,
    into: Sequence[Array] = (),
) -> tuple[Array, list[Array]]:
    """Apply the step to every sample.

    Parameters
    ----------
    recursion : Recursion
    data : sequence of (n, m_i) arrays
        One row per sample.
    carry : (nc,) array
        The memory before the first of these samples.
    progress : callable
        Told the number of samples done.
    block : int, optional
        Samples per call of the machine code, between which the run can be interrupted; by default
        what takes about 50 ms. Does not change the result.
    into : sequence of (n, l_j) arrays, optional
        Where the outputs go, rows one after the other in memory; new arrays if not given.

    Returns
    -------
    carry : (nc,) array
        The memory after the last sample.
    outputs : list of (n, l_j) arrays

    Raises
    ------
    EngineError
        If the recursion cannot be compiled or the data do not fit it.
    """
    program = compiled(recursion)
    rows, memory = checked_data(recursion, data, carry)
    n = len(rows[0])
    outputs = checked_places(recursion, into, n) or [
        np.empty((n, size)) for size in recursion.output_sizes
    ]
    workspace = program.workspace()
    for part in blocks(n, block):
        here = [a[part] for a in (*rows, *outputs)]
        program.code(part.stop - part.start, [memory, *workspace, *here])
        progress(part.stop)
    return memory, outputs


class Stepper:
    """A recursion that is applied to one sample after the other, as they come.

    Parameters
    ----------
    recursion : Recursion

    Raises
    ------
    EngineError
        If the recursion cannot be compiled.
    """

    def __init__(self, recursion: Recursion) -> None:
        program = compiled(recursion)
        self.carry = np.array(recursion.carry0, dtype=np.float64)
        """The memory (nc,) before the coming sample; may be overwritten in place."""
        self._inputs = [np.zeros(size) for size in recursion.input_sizes]
        self._outputs = [np.zeros(size) for size in recursion.output_sizes]
        arrays = [self.carry, *program.workspace(), *self._inputs, *self._outputs]
        self._step = program.code.bound(1, arrays)

    def step(self, data: Sequence[Array]) -> list[Array]:
        """Apply the step to the data (m_i,) of one sample and return its outputs (l_j,)."""
        for place, values in zip(self._inputs, data, strict=True):
            place[:] = values
        self._step()
        return [output.copy() for output in self._outputs]


def checked_data(
    recursion: Recursion, data: Sequence[Array], carry: Array
) -> tuple[list[Array], Array]:
    """Data with rows one after the other in memory, and a copy of the carry.

    Raises
    ------
    EngineError
        If a size is wrong; the machine code would read memory that is not its own.
    """
    rows = [np.ascontiguousarray(d, dtype=np.float64) for d in data]
    memory = np.array(carry, dtype=np.float64)
    shapes = [(len(rows[0]), size) for size in recursion.input_sizes]
    if [r.shape for r in rows] != shapes or memory.shape != recursion.carry0.shape:
        raise EngineError(
            f"'{recursion.name}' takes data of shape {shapes} and a carry of shape "
            f"{recursion.carry0.shape}, not {[r.shape for r in rows]} and {memory.shape}"
        )
    return rows, memory


def checked_places(recursion: Recursion, into: Sequence[Array], n: int) -> list[Array]:
    """Arrays that the machine code may write to; as `checked_data`."""
    shapes = [(n, size) for size in recursion.output_sizes]
    fits = [p.shape for p in into] == shapes and all(
        p.dtype == np.float64 and p.flags.c_contiguous and p.flags.writeable for p in into
    )
    if into and not fits:
        raise EngineError(f"'{recursion.name}' puts out arrays of shape {shapes}")
    return list(into)


def blocks(n: int, size: int | None) -> Iterator[slice]:
    """Cut n samples into blocks of the given size, or such that each takes `BLOCK_SECONDS`."""
    start, now = 0, size or FIRST_BLOCK
    while start < n:
        began = time.perf_counter()
        stop = min(start + now, n)
        yield slice(start, stop)
        elapsed = time.perf_counter() - began
        if size is None:
            now = int(min(max(now * BLOCK_SECONDS / max(elapsed, 1e-9), 1), 8 * now))
        start = stop


@functools.lru_cache(maxsize=64)
@built_alone
def _compiled(step: ca.Function, lanes: int) -> Compiled:
    key = json.dumps([step.serialize(), lanes, _versions(), machine.processor()])
    name = f"{step.name()}_{hashlib.sha256(key.encode()).hexdigest()[:32]}"
    kept = cache.read_kept(name)
    parts = None if kept is None else _unpacked(kept)
    if parts is None:
        program, width = walk(step), Width(lanes)
        buffers = llvm.given(program, width)
        parts = (
            [b.size for b in buffers if b.values is None],
            [np.array(b.values) for b in buffers if b.values is not None],
            list(program.kernels),
            machine.assemble_code(llvm.write_llvm(program, width)),
        )
        cache.keep(name, _packed(*parts))
    given, tables, kernels, code = parts
    symbols = {kernel_symbol(kernel): library.address(kernel) for kernel in kernels}
    repeated = tuple(np.repeat(table, lanes) for table in tables)
    return Compiled(machine.load_code(code, symbols), tuple(given), lanes, repeated)


Parts = tuple[list[int], list[Array], list[str], bytes]
"""Sizes of buffers, tables of constants, kernels and machine code."""


def _packed(given: list[int], tables: list[Array], kernels: list[str], code: bytes) -> bytes:
    head = json.dumps([given, [table.size for table in tables], kernels]).encode()
    return b"".join([head, b"\n", *(table.tobytes() for table in tables), code])


def _unpacked(kept: bytes) -> Parts | None:
    """What `_packed` was given; None if it is anything else."""
    head, _, rest = kept.partition(b"\n")
    try:
        match json.loads(head):
            case [list() as given, list() as sizes, list() as kernels] if (
                all(type(g) is int and g >= 0 for g in (*given, *sizes))
                and all(isinstance(k, str) for k in kernels)
                and len(rest) > 8 * sum(sizes)
            ):
                ends = np.cumsum(sizes, dtype=int)
                numbers = np.frombuffer(rest, count=sum(sizes))
                tables = np.split(numbers, ends[:-1]) if sizes else []
                return given, tables, kernels, rest[8 * sum(sizes) :]
    except (ValueError, RecursionError):
        pass
    return None


@functools.cache
def _versions() -> list[str]:
    """What the code depends on beside the recursion; the writers themselves by their text."""
    texts = sorted(Path(__file__).parent.rglob("*.py"))
    writers = hashlib.sha256(b"".join(file.read_bytes() for file in texts)).hexdigest()
    versions = importlib.metadata.version("backsight"), llvmlite.__version__
    return [*versions, writers, sources.fingerprint()]
