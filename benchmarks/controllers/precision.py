"""What single precision costs: the self-test of every example in it."""

import dataclasses
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from backsight.errors import EngineError
from backsight.estimators.base import AbstractEstimator
from backsight.export import export_c
from backsight.solvers.box import GaussNewton
from benchmarks.controllers.examples import NAMES, Example, example

FIXED = GaussNewton(3, tolerance=0.0, active_set_passes=3)

DEVIATION = re.compile(r"x_hat +deviation (\S+) of")

CONDITION = re.compile(r"condition number (\S+) in .* is up to (\S+) times")


@dataclasses.dataclass(frozen=True)
class Row:
    """An estimator in single precision.

    Parameters
    ----------
    example, estimator : str
    deviation : float
        Of the estimates, largest, by their smallest standard deviation.
    refusal : str
        Of the export; empty if there is none.
    """

    example: str
    estimator: str
    deviation: float
    refusal: str


def rows() -> Iterator[Row]:
    """Estimators of all examples; those with step control also with a fixed effort."""
    for name in NAMES:
        on = example(name)
        for word, estimator in on.estimators.items():
            yield _row(on, word, estimator)
            if hasattr(estimator, "optimiser"):
                fixed = dataclasses.replace(estimator, optimiser=FIXED)
                yield _row(on, f"{word}, 3 iterations", fixed)


def _row(on: Example, word: str, estimator: AbstractEstimator) -> Row:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "c"
        given = estimator, on.model, on.recording, folder
        export_c(*given, name="it", precision="float", accuracy=np.inf)
        flags = ["-std=c99", "-O0", "-w"]
        command = ["cc", *flags, "it.c", "it_selftest.c", "-lm", "-o", "it"]
        subprocess.run(command, cwd=folder, check=True)
        said = subprocess.run(["./it"], cwd=folder, capture_output=True, text=True, check=False)
        (deviation,) = DEVIATION.findall(said.stdout)
        refusal = ""
        if said.returncode:
            try:
                export_c(*given, name="it", precision="float", force=True)
            except EngineError as error:
                refusal = str(error)
    return Row(on.name, word, float(deviation), refusal)


def table(found: list[Row]) -> str:
    """The rows in Markdown."""
    head = (
        "| example | estimator | largest deviation of a state, by its band | condition number "
        "| state by its band | 1 % |\n|---|---|---|---|---|---|"
    )
    lines = []
    for r in found:
        numbers = CONDITION.search(r.refusal)
        condition, size = numbers.groups() if numbers else ("", "")
        verdict = "refused" if r.refusal else "held"
        cells = r.example, r.estimator, f"{r.deviation:.1g}", condition, size, verdict
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([head, *lines])
