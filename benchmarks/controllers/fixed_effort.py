"""What a fixed effort costs: operations of a sample at most, and how far the estimate is off."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from backsight.engine.program import effort, walk
from backsight.estimators.base import AbstractEstimator
from backsight.run.estimation import estimate
from backsight.schema import Status
from backsight.solvers.box import GaussNewton
from benchmarks.controllers.examples import Example, example

SAMPLES = 1000
"""Of each recording, at most."""

CASES = (("stage", "MHO"), ("motor", "MHE"), ("quarter_car", "MHE"), ("beam", "CS-MHE"))

ITERATIONS = (1, 2, 3)

STEPS = (5, 10, 20)
"""Of an active set of forces."""


@dataclasses.dataclass(frozen=True)
class Row:
    """An estimator with a fixed effort beside itself without.

    Parameters
    ----------
    example, estimator, effort : str
    operations : int
        Of a sample at most.
    mean, largest : float
        Deviation of the estimate from that without a limit, in standard deviations: root mean
        square over states and samples, and largest.
    told : float
        Share of samples with the status *iteration limit*.
    """

    example: str
    estimator: str
    effort: str
    operations: int
    mean: float
    largest: float
    told: float


def rows() -> Iterator[Row]:
    """All rows; of each example the estimator as it is comes first."""
    for name, chosen in CASES:
        on = example(name)
        plain = on.estimators[chosen]
        yield from _rows(on, chosen, {"to the end": plain} | dict(_limited(plain)))


def _limited(plain: AbstractEstimator) -> Iterator[tuple[str, AbstractEstimator]]:
    if hasattr(plain, "optimiser"):
        for k in ITERATIONS:
            changes: dict[str, Any] = {
                "optimiser": GaussNewton(k, tolerance=0.0, active_set_passes=3)
            }
            yield f"{k} iteration{'s' * (k > 1)}", dataclasses.replace(plain, **changes)
        return
    for k in STEPS:
        changes = {"max_steps": k}
        yield f"{k} steps", dataclasses.replace(plain, **changes)


def _rows(on: Example, name: str, ways: dict[str, AbstractEstimator]) -> Iterator[Row]:
    recording = on.recording.isel(time=slice(SAMPLES))
    first = None
    for way, estimator in ways.items():
        found = estimate(estimator, on.model, recording)
        first = found if first is None else first
        steps = walk(estimator.compile(on.model, float(recording.attrs["dt"])).step)
        off = (found["x_hat"] - first["x_hat"]) / first["x_std"].where(first["x_std"] > 0)
        limit = (found["status"].values.astype(int) & int(Status.ITERATION_LIMIT)) > 0
        yield Row(
            on.name,
            name,
            way,
            effort(steps).arithmetic,
            float(np.sqrt((off**2).mean())),
            float(np.abs(off).max()),
            float(limit.mean()),
        )


def table(found: list[Row]) -> str:
    """The rows in Markdown."""
    head = (
        "| example | estimator | effort | operations, at most | deviation, rms | largest "
        "| status set |\n|---|---|---|---|---|---|---|"
    )
    lines = [
        f"| {r.example} | {r.estimator} | {r.effort} | {r.operations} | {r.mean:.2g} "
        f"| {r.largest:.2g} | {100 * r.told:.1f} % |"
        for r in found
    ]
    return "\n".join([head, *lines])
