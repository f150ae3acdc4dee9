"""What happens once: import, help, tracing, compiling; each time in a process of its own."""

import dataclasses
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from backsight.engine import native
from benchmarks import problems
from benchmarks.contest import clock

TASKS = {
    "import backsight": ["-c", "import backsight"],
    "backsight --help": ["-m", "backsight", "--help"],
}


PROBLEMS = {"observer": problems.observer, "chain": problems.chain, "dense": problems.dense}
"""What is compiled; the models of the filters have 60 states."""

TEXTS = {
    "observer": "the moving horizon observer",
    "chain": "the filter of 60 states, row of masses",
    "dense": "the filter of 60 states, dense",
}


@dataclasses.dataclass(frozen=True)
class Startup:
    """Least and median time of several processes [s]."""

    name: str
    best: float
    median: float


def compiling(problem: str) -> str:
    """Name of the time that it takes to compile a problem."""
    return f"emit and compile {TEXTS[problem]}"


def from_cache(problem: str) -> str:
    """Name of the time that it takes to load it from the cache."""
    return f"load {TEXTS[problem]} from the cache"


def startups(*, times: int) -> list[Startup]:
    """Whole processes, `times` of each kind; tracing and compiling, in half as many."""
    for arguments in TASKS.values():
        _process(arguments)  # which may write byte code
    measured = [
        _summary(name, [_process(arguments) for _ in range(times)])
        for name, arguments in TASKS.items()
    ]
    for name, text in TEXTS.items():
        pairs = [_compilations(name) for _ in range((times + 1) // 2)]
        measured += [
            _summary(f"trace {text}", [first[0] for first, _ in pairs]),
            _summary(compiling(name), [first[1] for first, _ in pairs]),
            _summary(from_cache(name), [second[1] for _, second in pairs]),
        ]
    return measured


def print_compile_times(name: str) -> None:
    """Trace and compile once, print both times [s]; this is what the new process runs."""
    problem = PROBLEMS[name]()
    problem.recording.load()
    traced, _ = clock(lambda: problem.recursion)
    compiled, _ = clock(lambda: native.compiled(problem.recursion))
    print(traced, compiled)


def _summary(name: str, times: list[float]) -> Startup:
    return Startup(name, min(times), float(np.median(times)))


def _compilations(name: str) -> tuple[list[float], list[float]]:
    """Times with an empty cache, and with the cache that this left."""
    code = f"from benchmarks.startup import print_compile_times as p; p({name!r})"
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"BACKSIGHT_CACHE": folder}
        runs = [
            subprocess.run(
                [sys.executable, "-c", code],
                env=environment,
                check=True,
                capture_output=True,
                text=True,
            )
            for _ in range(2)
        ]
    first, second = ([float(t) for t in run.stdout.split()] for run in runs)
    return first, second


def _process(arguments: list[str]) -> float:
    """Time of a process, without waiting for others."""
    wall, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    wall, after = time.perf_counter() - wall, os.times()
    processor = after.children_user - before.children_user
    processor += after.children_system - before.children_system
    # Windows does not count the children's time.
    return min(wall, processor or wall)
