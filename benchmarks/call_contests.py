"""What a call of `estimate` costs beside the loop over the samples."""

import dataclasses
from functools import partial

import numpy as np
import xarray as xr

import backsight as bs
from backsight.engine import native
from backsight.run.estimation import ready
from backsight.run.estimation.results.outputs import as_outputs
from backsight.types import Array
from benchmarks import problems
from benchmarks.contest import Contender, Contest, Entry
from benchmarks.problems import Problem

SHORT, LONG = 2000, 100_000
PER_CALL = 1000
"""Of this many, microseconds of one are milliseconds of all."""

MANY = 16

CALL = f"A call with {SHORT} samples, extended Kalman filter of an oscillator"
WHOLE = f"A call with {LONG} samples, extended Kalman filter, 6 states"

ESTIMATE = "estimate(), all in"
EACH = f"estimate_many(), each of {MANY}, 1 core"
LOOP = "the loop alone, with the same outputs"
SOME = "estimate() with outputs = ['x_std']"


def contests() -> tuple[Contest, ...]:
    """Short and long recordings, with what is made of the estimator before kept."""
    return (
        Contest(
            CALL,
            "ms per call",
            (
                Entry(ESTIMATE, lambda: _estimate(_oscillator())),
                Entry(EACH, _many),
                Entry(LOOP, lambda: _loop(_oscillator())),
            ),
            "2 states; the second call with this estimator, model and period, and all later ones.",
        ),
        Contest(
            WHOLE,
            "ms per call",
            (
                Entry(ESTIMATE, lambda: _estimate(_long())),
                Entry(SOME, lambda: _estimate(_long(), outputs=("x_std",))),
                Entry(LOOP, lambda: _loop(_long())),
            ),
            "8 Heun sub-steps; 436 bytes per sample are kept, 108 with the outputs named.",
        ),
    )


def _oscillator() -> Problem:
    spring = bs.sdof(k=40.0, b=0.8)
    recording = bs.simulate(spring, np.ones((SHORT, 1)), dt=0.05, sigma_y=1e-4, seed=1)
    ekf = bs.EKF(bs.Noise(sigma_y=1e-4, sigma_w=1e-6), bs.Prior(sigma_x0=1.0))
    return Problem(ekf, spring, recording.drop_vars("x_true"))


def _long() -> Problem:
    short = problems.stage_filter("ode")
    given = short.recording
    times = -(-LONG // given.sizes["time"])
    u, y = (np.tile(given[k].values, (times, 1))[:LONG] for k in ("u", "y"))
    inputs, outputs = (
        {s.name: s.unit for s in k} for k in (short.model.inputs, short.model.outputs)
    )
    recording = bs.from_arrays(dt=given.attrs["dt"], u=u, y=y, inputs=inputs, outputs=outputs)
    return dataclasses.replace(short, recording=recording)


def _estimate(problem: Problem, outputs: tuple[str, ...] | None = None) -> Contender:
    def work() -> Array:
        found = bs.estimate(problem.estimator, problem.model, problem.recording, outputs=outputs)
        return found["x_hat"].values

    return Contender(work, PER_CALL)


def _many() -> Contender:
    problem = _oscillator()
    recordings: list[xr.Dataset] = [problem.recording] * MANY

    def work() -> Array:
        found = bs.estimate_many(problem.estimator, problem.model, recordings, threads=1)
        return found[0]["x_hat"].values

    return Contender(work, PER_CALL * MANY)


def _loop(problem: Problem) -> Contender:
    task = ready(problem.estimator, problem.model, problem.recording, outputs=as_outputs(None))
    recursion = task.recursion
    run = partial(native.run, recursion, task.data, carry=recursion.carry0)
    return Contender(lambda: run()[1][0], PER_CALL)
