"""How the time of a sample grows with window, states, sub-steps and recordings."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import lanes, native
from backsight.estimators import MHE, MHO
from backsight.types import Array
from benchmarks import flops, problems, process_noise, struck_beam
from benchmarks.contest import Contender, turns
from benchmarks.ours import stage_recordings
from benchmarks.peers import numpy_ekf
from benchmarks.problems import Problem

SAMPLES = 1000
"""Samples of a recording; a filter that runs by itself takes the whole recording."""

DISTINCT = 16
"""Different recordings; more than that are these again."""


@dataclasses.dataclass(frozen=True)
class Point:
    """Time of a sample for one size.

    Parameters
    ----------
    study, series : str
    size : int
    best, median : float
        [us per sample]
    operations : float
        Floating-point operations per sample, NaN if not counted.
    """

    study: str
    series: str
    size: int
    best: float
    median: float
    operations: float = np.nan


@dataclasses.dataclass(frozen=True)
class Study:
    """A plot: for every series its sizes and how to make the contender of a size."""

    name: str
    axis: str
    series: dict[str, tuple[Sequence[int], Callable[[int], Contender | Problem]]]


OBSERVER = "moving horizon observer"
EKF = "extended Kalman filter"
ESTIMATOR = "moving horizon estimator, process noise"
SPARSE = "compressive-sensing estimator"
WINDOW = "window"


def studies(*, quick: bool) -> tuple[Study, ...]:
    """The plots; with `quick` only few sizes."""

    def sizes(*all_sizes: int) -> Sequence[int]:
        return all_sizes[:: max(len(all_sizes) - 1, 1)] if quick else all_sizes

    substeps = sizes(1, 2, 4, 8, 16, 32)
    recordings = sizes(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)
    states = sizes(2, 4, 6, 8, 10, 12, 14, 20, 30, 40, 50, 60)
    horizons, no_bounds = sizes(5, 10, 15, 25, 50, 100, 200), process_noise.FREE
    return (
        Study(
            WINDOW,
            "horizon N [samples]",
            {
                OBSERVER: (horizons, lambda n: problems.observer(N=n)),
                ESTIMATOR: (horizons, lambda n: process_noise.problem(no_bounds, N=n)),
            },
        ),
        Study(
            "sparse-window",
            "horizon N [samples], 8 nodes",
            {SPARSE: (sizes(5, 10, 15, 20, 30, 40, 50), struck_beam.with_horizon)},
        ),
        Study(
            "nodes",
            "nodes, 11 samples",
            {SPARSE: (sizes(8, 16, 32, 64, 128, 200), struck_beam.with_nodes)},
        ),
        Study(
            "substeps",
            "Heun sub-steps per sample",
            {
                OBSERVER: (substeps, lambda n: problems.observer(integrator=_heun(n))),
                EKF: (substeps, lambda n: problems.stage_filter(integrator=_heun(n))),
            },
        ),
        Study(
            "states",
            "states",
            {
                f"{EKF}, row of masses": (states, lambda n: problems.chain(n // 2)),
                f"{EKF}, dense": (states, problems.dense),
                "NumPy with BLAS, dense": (states, lambda n: numpy_ekf.build(problems.dense(n))),
                f"{OBSERVER}, row of masses": (sizes(2, 4, 6, 8, 10, 12), _observed_chain),
            },
        ),
        Study(
            "recordings",
            "recordings at once, all cores",
            {
                OBSERVER: (recordings, lambda n: _many(problems.observer(), n)),
                EKF: (recordings, lambda n: _many(problems.stage_filter(), n)),
            },
        ),
    )


def carry_out(study: Study, *, rounds: int, seconds: float) -> list[Point]:
    """Compile all sizes, then time them in turns."""
    points, contenders = [], []
    for name, (sizes, build) in study.series.items():
        for size in sizes:
            built, operations = build(size), np.nan
            if isinstance(built, Problem):
                operations = float(flops.count(built.recursion))
                built = _single(built)
            built.work()
            contenders.append(built)
            points.append(Point(study.name, name, size, np.nan, np.nan, operations))
    measured = turns(contenders, rounds=rounds, seconds=seconds)
    return [
        dataclasses.replace(
            point,
            best=float(1e6 * spent.min() / contender.samples),
            median=float(1e6 * np.median(spent) / contender.samples),
        )
        for point, contender, (spent, _) in zip(points, contenders, measured, strict=True)
    ]


def exponent(points: Sequence[Point], study: str, series: str) -> float:
    """Slope of the time against the size in logarithms, by least squares."""
    here = [p for p in points if (p.study, p.series) == (study, series)]
    sizes, times = (np.log([getattr(p, name) for p in here]) for name in ("size", "best"))
    return float(np.polyfit(sizes, times, 1)[0])


def _heun(substeps: int) -> Integrator:
    return Integrator("heun", substeps)


def _observed_chain(states: int) -> Problem:
    chain = problems.chain(states // 2)
    return dataclasses.replace(chain, estimator=problems.observer_of(chain.estimator))


def _single(problem: Problem) -> Contender:
    samples = SAMPLES if isinstance(problem.estimator, MHO | MHE) else len(problem.data[0])
    data = [d[:samples] for d in problem.data]
    recursion = problem.recursion

    def work() -> Array:
        return native.run(recursion, data, carry=recursion.carry0)[0]

    return Contender(work, len(data[0]))


def _many(problem: Problem, count: int) -> Contender:
    distinct = stage_recordings(problem, min(count, DISTINCT))
    data = [[d[:SAMPLES] for d in distinct[i % DISTINCT]] for i in range(count)]
    carries = [problem.recursion.carry0] * count

    def work() -> Array:
        return lanes.run_many(problem.recursion, data, carries=carries)[0][0]

    return Contender(work, count * SAMPLES)
