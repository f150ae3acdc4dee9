"""Whether exported code holds its accuracy in single precision, found out by running it."""

import re
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from backsight.errors import BacksightError, EngineError
from backsight.estimators.scaled import setting
from backsight.export._compiler import compiler, this_machine
from backsight.export._selftest import Vectors
from backsight.export._written import Written
from backsight.types import Array

FLAGS = ["-std=c99", "-O0", "-ffp-contract=off", "-w"]

PATIENCE = 600
"""Seconds after which a compiler is given up."""

LINE = re.compile(r"^(\w+) +deviation (\S+) of its ([\w ]+?)(  FAILED)?$", re.M)
"""A line of the self-test."""

DIGITS = float(np.finfo(np.float32).eps) / 2
"""Rounding of a number in single precision."""


def check_single(code: Written, files: Mapping[str, str], vectors: Vectors) -> None:
    """Run the self-test of code in single precision.

    Raises
    ------
    EngineError
        If it fails, with what makes it fail; or if there is no compiler.
    """
    told = _run(code.name, files)
    failed = [(name, value, of) for name, value, of, fault in LINE.findall(told) if fault]
    if not failed:
        return
    worst = ", ".join(f"'{n}' by {float(v):.2g} of its {of}" for n, v, of in failed)
    advice = "export it in double precision"
    if code.estimator.judges_steps:
        advice += (
            ", or with a fixed number of iterations (optimiser tolerance = 0): in single precision "
            "a step cannot be judged that changes the cost by less than its rounding"
        )
    raise EngineError(
        f"single precision is not enough for {code.estimator.title}: on the recording it is off in "
        f"{worst}. {_reason(code, vectors)}; {advice}, or allow more (accuracy)"
    )


def _run(name: str, files: Mapping[str, str]) -> str:
    """What the self-test says."""
    try:
        command = compiler(this_machine())
    except EngineError as error:
        raise EngineError(
            f"single precision is checked by running the code, but {error}; accuracy = inf leaves "
            "that to the controller"
        ) from error
    with tempfile.TemporaryDirectory(prefix="backsight-single-") as temporary:
        folder = Path(temporary)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        program = folder / "selftest"
        sources = [f"{name}.c", f"{name}_selftest.c"]
        built = [*command, *FLAGS, "-o", program.name, *sources, "-lm"]
        try:
            done = subprocess.run(
                built, cwd=folder, capture_output=True, text=True, check=False, timeout=PATIENCE
            )
            if done.returncode:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                raise EngineError(f"the code could not be compiled: {last}")
            ran = subprocess.run(
                [str(program)], capture_output=True, text=True, check=False, timeout=PATIENCE
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise EngineError(f"the code could not be compiled and run: {error}") from error
    return ran.stdout


def _reason(code: Written, vectors: Vectors) -> str:
    """How many digits the numbers need: condition of the covariance, and states by their bands."""
    x, packed = vectors.outputs["x_hat"], vectors.outputs["P"]
    n = x.shape[1]
    rows, columns = np.triu_indices(n)
    P = np.zeros((len(x), n, n))
    P[:, rows, columns] = P[:, columns, rows] = packed
    band = np.sqrt(np.maximum(P.diagonal(axis1=1, axis2=2), 0.0))
    worst = _largest(np.abs(x), band)
    name = code.model.states[int(np.argmax(worst))].name
    scale = _scales(code, band)
    condition = _condition(P / (scale[:, None] * scale))
    return (
        f"Its covariance has the condition number {condition:.0e} in the units of the prior, and "
        f"'{name}' is up to {worst.max():.0e} times its standard deviation, where a float rounds "
        f"to {worst.max() * DIGITS:.1g} of it in every step"
    )


def _largest(values: Array, band: Array) -> Array:
    known = np.where(band > 0, band, np.inf)
    return np.max(values / known, axis=0)


def _scales(code: Written, band: Array) -> Array:
    """Scales of the states inside, or where there are none the first bands."""
    try:
        noise, prior = code.estimator.assumed
        dt = code.recursion.dt
        integrator = code.estimator.chosen(code.model, dt)
        return setting(code.model, dt, noise=noise, prior=prior, integrator=integrator).sx
    except BacksightError:
        return np.where(band[0] > 0, band[0], 1.0)


def _condition(P: Array) -> float:
    """Largest of all samples; of what is not known exactly."""
    values = np.linalg.eigvalsh(P)
    least = np.where(values > 0, values, np.inf).min(axis=1)
    return float((values.max(axis=1) / least).max())
