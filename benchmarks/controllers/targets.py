"""Sizes of exported code on microcontrollers, and instructions of a step in an emulator."""

import dataclasses
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine.program import effort, walk
from backsight.estimators.base import AbstractEstimator
from backsight.export import export_c
from backsight.models.model import Model
from backsight.run.estimation import match
from backsight.solvers.box import GaussNewton
from backsight.testing import CASES
from benchmarks.controllers.cortex_m import BOARDS, Counted
from benchmarks.controllers.examples import example

SAMPLES = 60

FIXED = GaussNewton(2, tolerance=0.0, active_set_passes=3)


@dataclasses.dataclass(frozen=True)
class Row:
    """An estimator on a processor.

    Parameters
    ----------
    title, processor : str
    operations, ram : int
        Operations of a step at most; bytes of memory and work space.
    counted : Counted
    """

    title: str
    processor: str
    operations: int
    ram: int
    counted: Counted


def estimators() -> Iterator[tuple[str, AbstractEstimator, Model, object]]:
    """Those of the table: of the contract's oscillator, and of examples, with a fixed effort."""
    for key, words in (
        ("kf", "KalmanFilter"),
        ("ekf", "EKF"),
        ("mho", "MHO, N = 5, 2 iterations"),
        ("mhe", "MHE, N = 2, 2 iterations"),
        ("csmhe", "CS-MHE, N = 6, 10 steps"),
    ):
        on = CASES[key].problem
        made = _limited(CASES[key].build(on, Integrator("rk4", 1)))
        recording = on.simulate(SAMPLES, seed=5, hold="zoh", noisy=True).recording(on.model)
        yield f"oscillator, {on.nx} states: {words}", made, on.model, recording
    for name, chosen, words in (
        ("motor", "EKF", "EKF, 4 states"),
        ("motor", "MHE", "MHE, 4 states, N = 20, 2 iterations"),
        ("beam", "CS-MHE", "CS-MHE, 6 states, 8 places, N = 10, 10 steps"),
    ):
        found = example(name)
        made = _limited(found.estimators[chosen])
        yield f"{name}: {words}", made, found.model, found.recording.isel(time=slice(SAMPLES))


def _limited(estimator: AbstractEstimator) -> AbstractEstimator:
    if hasattr(estimator, "optimiser"):
        return dataclasses.replace(estimator, optimiser=FIXED)
    if hasattr(estimator, "max_steps"):
        return dataclasses.replace(estimator, max_steps=10)
    return estimator


def rows() -> Iterator[Row]:
    """All rows: single precision on a Cortex-M4F, double on a Cortex-M7."""
    for title, estimator, model, recording in estimators():
        dt = float(recording.attrs["dt"])
        recursion = estimator.compile(model, dt)
        data = [np.asarray(d[:SAMPLES]) for d in match(model, recording, estimator=estimator)]
        for precision, board in BOARDS.items():
            kind: Literal["float", "double"] = "float" if precision == "float" else "double"
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary)
                export_c(
                    estimator, model, recording, folder / "c", name="it", precision=kind,
                    accuracy=np.inf,
                )  # fmt: skip
                ran = board.selftest(folder / "c", "it")
                if ran.returncode:
                    raise RuntimeError(f"{title} on {board.title}: {ran.stdout}")
                counted = board.count(folder / "c", "it", recursion, data)
                readme = (folder / "c" / "README.md").read_text("utf-8")
            line = next(k for k in readme.splitlines() if k.startswith("| RAM |"))
            numbers = [int(w) for w in line.split() if w.isdigit()]
            operations = effort(walk(recursion.step)).arithmetic
            yield Row(title, f"{board.title}, {precision}", operations, sum(numbers), counted)


def table(found: list[Row]) -> str:
    """The rows in Markdown."""
    head = (
        "| estimator | processor | code [kB] | tables [kB] | RAM [kB] | operations, at most "
        "| instructions of a step, mean | largest |\n|---|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {r.title} | {r.processor} | {r.counted.code / 1e3:.1f} | "
        f"{r.counted.constants / 1e3:.1f} | {r.ram / 1e3:.1f} | {r.operations} "
        f"| {r.counted.mean} | {r.counted.most} |"
        for r in found
    ]
    return "\n".join([head, *lines])
