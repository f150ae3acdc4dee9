"""Backsight's engines as contenders."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from backsight.engine import lanes, native, vm
from backsight.engine.recursion import Recursion
from backsight.run.estimation import estimate, match
from backsight.types import Array
from benchmarks import problems, windows
from benchmarks.contest import Contender
from benchmarks.problems import Problem
from benchmarks.stage import stage

VM_SAMPLES = 500
"""Samples that the virtual machine runs."""


def expected(problem: Problem) -> Array:
    """Estimates of the native engine, (n, nx) scaled."""
    return _native(problem)()


def machine_code(problem: Problem) -> Contender:
    """The whole recording in machine code, one call from Python; compared with the other engine."""
    native.compiled(problem.recursion)
    return Contender(_native(problem), len(problem.data[0]), _virtual(problem)())


def whole_call(problem: Problem) -> Contender:
    """The public function: checks, tracing, loading from the cache, running, labelled results."""

    def work() -> Array:
        result = estimate(problem.estimator, problem.model, problem.recording, engine="native")
        return result["x_hat"].values / problem.setting.sx

    return Contender(work, len(problem.data[0]), expected(problem))


def virtual_machine(problem: Problem) -> Contender:
    """The same in CasADi's virtual machine."""
    work = _virtual(problem)
    return Contender(work, min(VM_SAMPLES, len(problem.data[0])), expected(problem))


def in_lanes(problem: Problem, recordings: Sequence[Sequence[Array]], threads: int) -> Contender:
    """Several recordings at once; compared with a run of the first by itself."""
    recursion = problem.recursion
    carries = [recursion.carry0] * len(recordings)
    into = [_places(recursion, len(recording[0])) for recording in recordings]

    def work() -> Array:
        lanes.run_many(recursion, recordings, carries=carries, threads=threads, into=into)
        return into[0][0] / problem.setting.sx

    single = native.run(recursion, recordings[0], carry=recursion.carry0)[1][0]
    samples = sum(len(recording[0]) for recording in recordings)
    return Contender(work, samples, single / problem.setting.sx)


def stage_recordings(problem: Problem, count: int) -> list[list[Array]]:
    """Data of distinct recordings of the stage."""
    return [list(match(problem.model, stage(seed))) for seed in range(count)]


def on_windows(method: problems.GaussNewton) -> Contender:
    """Our optimiser alone; the windows are repeated, since it is too fast to be timed on a few."""
    recursion = windows.optimiser(method)
    repeated = [np.tile(rows, (100, 1)) for rows in windows.rows()]

    def work() -> Array:
        return native.run(recursion, repeated, carry=recursion.carry0)[1][0]

    return Contender(work, len(repeated[0]), windows.minimisers())


def without_expectation(contender: Contender) -> Contender:
    """For a table in which the others compute something else."""
    return dataclasses.replace(contender, expected=None)


def _native(problem: Problem) -> functools.partial[Array]:
    # Outputs go to memory that is there, as those of the lanes: the program is timed, not how long
    # the system takes to give out pages, which depends on what ran before.
    run = functools.partial(native.run, into=_places(problem.recursion, len(problem.data[0])))
    return functools.partial(_estimates, problem, run, None)


def _places(recursion: Recursion, samples: int) -> list[Array]:
    return [np.empty((samples, size)) for size in recursion.output_sizes]


def _virtual(problem: Problem) -> functools.partial[Array]:
    return functools.partial(_estimates, problem, vm.run, VM_SAMPLES)


def _estimates(problem: Problem, run, samples: int | None) -> Array:
    recursion = problem.recursion
    _, outputs = run(recursion, [d[:samples] for d in problem.data], carry=recursion.carry0)
    return outputs[0] / problem.setting.sx
