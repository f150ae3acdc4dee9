"""Run a recursion over many recordings at once: in the lanes of vectors, and in threads."""

import concurrent.futures
import dataclasses
import os
import threading
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from backsight.engine import machine, native
from backsight.engine.recursion import Recursion
from backsight.types import Array

Outcome = tuple[Array, list[Array]]
"""Carry after the last sample and outputs, as of `backsight.engine.native.run`."""

LOOK_SECONDS = 0.1
"""How often the waiting thread tells the progress and can be interrupted."""


def run_many(
    recursion: Recursion,
    recordings: Sequence[Sequence[Array]],
    *,
    carries: Sequence[Array],
    threads: int | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> list[Outcome]:
    """Apply the step to every sample of every recording.

    The recordings may have different lengths; each result equals that of a run of its own.

    Parameters
    ----------
    recursion : Recursion
    recordings : sequence of sequences of (n, m_i) arrays
        The data of each recording, one row per sample.
    carries : sequence of (nc,) arrays
        The memory before the first sample of each recording.
    threads : int, optional
        Number of threads; by default one for each processor core.
    progress : callable
        Told the number of samples done, of all recordings together.

    Returns
    -------
    list of (carry, outputs)
        For each recording what `backsight.engine.native.run` returns.

    Raises
    ------
    EngineError
        If the recursion cannot be compiled or the data do not fit it.
    """
    jobs = [_job(recursion, data, carry) for data, carry in zip(recordings, carries, strict=True)]
    longest_first = sorted((j for j in jobs if j.samples), key=lambda job: -job.samples)
    width = machine.widest()
    groups = [longest_first[i : i + width] for i in range(0, len(longest_first), width)]
    _run_groups(recursion, groups, threads or os.cpu_count() or 1, progress)
    return [(job.memory, job.outputs) for job in jobs]


@dataclasses.dataclass(frozen=True)
class _Job:
    """One recording with the place for its results."""

    rows: list[Array]
    memory: Array
    outputs: list[Array]

    @property
    def samples(self) -> int:
        return len(self.rows[0])


def _job(recursion: Recursion, data: Sequence[Array], carry: Array) -> _Job:
    rows, memory = native.checked(recursion, data, carry)
    return _Job(rows, memory, [np.empty((len(rows[0]), k)) for k in recursion.output_sizes])


def _run_groups(
    recursion: Recursion,
    groups: list[list[_Job]],
    threads: int,
    progress: Callable[[int], None],
) -> None:
    done = [0] * len(groups)
    stop = threading.Event()
    programs = {
        lanes: native.compiled(recursion, lanes=lanes)
        for lanes in {_lanes(group) for group in groups}
    }

    def work(number: int) -> None:
        group = groups[number]
        for count in _advance(programs[_lanes(group)], group):
            done[number] += count
            if stop.is_set():
                return

    with concurrent.futures.ThreadPoolExecutor(threads) as pool:
        waiting = {pool.submit(work, number) for number in range(len(groups))}
        try:
            while waiting:
                finished, waiting = concurrent.futures.wait(waiting, timeout=LOOK_SECONDS)
                for future in finished:
                    future.result()
                progress(sum(done))
        except BaseException:
            stop.set()
            pool.shutdown(cancel_futures=True)
            raise


def _lanes(group: list[_Job]) -> int:
    return 1 if len(group) == 1 else machine.widest()


def _advance(program: native.Compiled, group: list[_Job]) -> Iterator[int]:
    """Run a group to the end of its longest recording; yields the samples done in each block."""
    empty = program.lanes - len(group)
    lanes = [*group, *[group[0]] * empty]
    memory = np.stack([job.memory for job in lanes], axis=1)
    workspace = program.workspace()
    columns = [*zip(*(job.rows for job in lanes), strict=True)]
    columns += zip(*(job.outputs for job in lanes), strict=True)
    for part in native.blocks(group[0].samples, None):
        size = part.stop - part.start
        left = np.array([max(job.samples - part.start, 0) for job in group] + [0] * empty)
        # A recording that has ended still shows its last sample.
        here = [a[min(part.start, len(a) - 1) :] for column in columns for a in column]
        program.code(size, [memory, *workspace, *here, left])
        yield int(np.minimum(left, size).sum())
    for lane, job in enumerate(group):
        job.memory[:] = memory[:, lane]
