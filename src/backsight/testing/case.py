"""What an estimator is asked for, and an estimator at work on it."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native, vm
from backsight.engine.recursion import Recursion
from backsight.estimators.base import AbstractEstimator
from backsight.testing.problem import DT, TrialProblem

Build: TypeAlias = Callable[[TrialProblem, Integrator], AbstractEstimator]
Engine: TypeAlias = Literal["vm", "native"]
Hold: TypeAlias = Literal["zoh", "foh"]

ENGINES = {"vm": vm.run, "native": native.run}
"""Every engine by its name."""


@dataclasses.dataclass(frozen=True)
class Case:
    """An estimator and what it is asked for.

    Parameters
    ----------
    build : callable
        The estimator for a problem, in a setting in which its statistics hold. Of the `Integrator`
        it takes all, or ``hold``.
    k_known : bool
        The stiffness is given, for estimators that do not estimate parameters; the model is then
        linear.
    outputs : tuple of str
        What is measured.
    exact : bool
        The estimator is for linear models only and discretises them exactly.
    """

    build: Build
    k_known: bool = False
    outputs: tuple[str, ...] = ("position", "speed")
    exact: bool = False

    @property
    def problem(self) -> TrialProblem:
        """What the estimator has to solve."""
        return TrialProblem(k_known=self.k_known, outputs=self.outputs, exact=self.exact)


@dataclasses.dataclass(frozen=True)
class Subject:
    """An estimator under test, with an engine and a way to take inputs between the samples.

    Parameters
    ----------
    case : Case
    engine : {"vm", "native"}
    hold : {"zoh", "foh"}
    """

    case: Case
    engine: Engine = "vm"
    hold: Hold = "zoh"

    @property
    def problem(self) -> TrialProblem:
        """What the estimator has to solve, in the original form."""
        return self.case.problem

    def build(self, problem: TrialProblem) -> AbstractEstimator:
        """The estimator for a problem."""
        return self.case.build(problem, Integrator("rk4", 1, self.hold))

    def recursion(self) -> Recursion:
        """The estimator compiled for its problem in the original form, once for all checks."""
        return _compiled(self.case, self.hold)

    def amount(self, n: int) -> int:
        """How much of n to run: a fifth in the virtual machine, which is slow and does the same."""
        return n if self.engine == "native" else max(n // 5, 1)

    def step(
        self,
        recursion: Recursion,
        arrays: list[np.ndarray],
        carry: np.ndarray | None = None,
        *,
        block: int = 65536,
        progress: Callable[[int], None] = lambda _: None,
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Carry after u, y and mask, and the outputs as the engine gives them."""
        start = recursion.carry0 if carry is None else carry
        run = ENGINES[self.engine]
        return run(recursion, arrays, carry=start, block=block, progress=progress)

    def run(self, recursion: Recursion, arrays: list[np.ndarray]) -> dict[str, np.ndarray]:
        """Outputs by name over u, y and mask from the first sample on."""
        _, outputs = self.step(recursion, arrays)
        return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


@functools.lru_cache(maxsize=64)
def _compiled(case: Case, hold: Hold) -> Recursion:
    on = Subject(case, hold=hold)
    return on.build(on.problem).compile(on.problem.model, DT)
