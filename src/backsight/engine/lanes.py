"""Run a recursion over many recordings at once: in the lanes of vectors, and in threads."""

import dataclasses
import itertools
import threading
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from backsight.engine import native
from backsight.engine.llvm import machine
from backsight.engine.parallel import in_threads
from backsight.engine.recursion import Recursion
from backsight.errors import EngineError
from backsight.kernels import library
from backsight.types import Array

Outcome = tuple[Array, list[Array]]
"""Carry after the last sample and outputs, as of `backsight.engine.native.run`."""


def run_many(
    recursion: Recursion,
    recordings: Sequence[Sequence[Array]],
    *,
    carries: Sequence[Array],
    lanes: int | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] = lambda _: None,
    into: Sequence[Sequence[Array]] = (),
) -> list[Outcome]:
    """Apply the step to every sample of every recording.

    The recordings may have different lengths; each result equals that of a run of its own, and to
    the last bit does not depend on which recordings are beside it: also a single one goes through
    the program for vectors, whose rounding differs from that for one.

    Parameters
    ----------
    recursion : Recursion
    recordings : sequence of sequences of (n, m_i) arrays
        The data of each recording, one row per sample.
    carries : sequence of (nc,) arrays
        The memory before the first sample of each recording.
    lanes : int, optional
        Recordings that advance together; by default as many as run well. Code for fewer is compiled
        sooner.
    threads : int, optional
        Number of threads; by default one for each processor core.
    progress : callable
        Told the number of samples done, of all recordings together.
    into : sequence of sequences of (n, l_j) arrays, optional
        Where the outputs of each recording go, as of `backsight.engine.native.run`; new arrays if
        not given. The system needs a tenth of the time of a filter to give out new memory.

    Returns
    -------
    list of (carry, outputs)
        For each recording what `backsight.engine.native.run` returns.

    Raises
    ------
    EngineError
        If the recursion cannot be compiled or the data do not fit it.
    """
    if into and len(into) != len(recordings):
        raise EngineError(f"places for {len(into)} of {len(recordings)} recordings")
    checked = [
        native.checked_data(recursion, d, c) for d, c in zip(recordings, carries, strict=True)
    ]
    longest_first = sorted(range(len(checked)), key=lambda k: -len(checked[k][0][0]))
    jobs: dict[int, _Job] = {}
    groups: list[list[_Job]] = []
    width = lanes or machine.widest()
    for first in range(0, len(longest_first), width):
        members = longest_first[first : first + width]
        lengths = [len(checked[k][0][0]) for k in members]
        if into:
            outputs = [
                native.checked_places(recursion, into[k], n)
                for k, n in zip(members, lengths, strict=True)
            ]
        else:
            outputs = _places(lengths, recursion.output_sizes)
        group = {k: _Job(*checked[k], o) for k, o in zip(members, outputs, strict=True)}
        jobs |= group
        groups.append([job for job in group.values() if job.samples])
    program = native.compiled(recursion, lanes=width)
    _run_groups(program, [g for g in groups if g], threads, progress)
    return [(jobs[k].memory, jobs[k].outputs) for k in range(len(checked))]


@dataclasses.dataclass(frozen=True)
class _Job:
    """One recording with the place for its results."""

    rows: list[Array]
    memory: Array
    outputs: list[Array]

    @property
    def samples(self) -> int:
        return len(self.rows[0])


def _places(lengths: Sequence[int], sizes: Sequence[int]) -> list[list[Array]]:
    """Outputs of several recordings.

    They are one piece of memory: for many small ones the system takes a tenth of all time.
    """
    shapes = [(n, size) for n in lengths for size in sizes]
    ends = np.cumsum([0, *(n * size for n, size in shapes)])
    whole = np.empty(ends[-1])
    arrays = [
        whole[a:b].reshape(shape)
        for (a, b), shape in zip(itertools.pairwise(ends), shapes, strict=True)
    ]
    return [arrays[k * len(sizes) : (k + 1) * len(sizes)] for k in range(len(lengths))]


def _run_groups(
    program: native.Compiled,
    groups: list[list[_Job]],
    threads: int | None,
    progress: Callable[[int], None],
) -> None:
    done = [0] * len(groups)
    stop = threading.Event()

    if threads == 1:
        # A pool of one thread costs more than a short run.
        with library.one_thread():
            for number, group in enumerate(groups):
                for count in _advance(program, group):
                    done[number] += count
                    progress(sum(done))
        return

    def work(number: int) -> None:
        group = groups[number]
        for count in _advance(program, group):
            done[number] += count
            if stop.is_set():
                return

    with library.one_thread():
        in_threads(
            work,
            range(len(groups)),
            threads=threads,
            look=lambda: progress(sum(done)),
            stop=stop.set,
        )


def _advance(program: native.Compiled, group: list[_Job]) -> Iterator[int]:
    """Run a group to the end of its longest recording; yields the samples done in each block.

    A lane without a recording, or whose recording has ended, does the same as the first one, to
    the same place.
    """
    lanes = [*group, *[group[0]] * (program.lanes - len(group))]
    memory = np.stack([job.memory for job in lanes], axis=1)
    still = [memory, *program.workspace()]
    start = 0
    for end in sorted({job.samples for job in group}):
        columns = [*zip(*(job.rows for job in lanes), strict=True)]
        columns += zip(*(job.outputs for job in lanes), strict=True)
        moving = [array for column in columns for array in column]
        origin = np.array([array.ctypes.data for array in (*still, *moving)])
        step = np.array([0] * len(still) + [array.strides[0] for array in moving])
        running = sum(job.samples > start for job in group)
        for part in native.blocks(end - start, None):
            program.code.at(part.stop - part.start, origin + (start + part.start) * step)
            yield running * (part.stop - part.start)
        for lane, job in enumerate(lanes):
            if job.samples == end:
                job.memory[:] = memory[:, lane]
                lanes[lane], memory[:, lane] = group[0], memory[:, 0]
        start = end
