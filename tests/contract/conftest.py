"""What the contract is checked over: estimators, engines, and held or interpolated inputs."""

from collections.abc import Callable

import numpy as np
import pytest

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native, vm
from backsight.engine.recursion import Recursion
from backsight.estimators.base import AbstractEstimator
from contract.cases import CASES, DT, Case, Problem

ENGINES = {"vm": vm.run, "native": native.run}
"""Every engine by its name."""


@pytest.fixture(params=list(ENGINES))
def engine(request):
    return ENGINES[request.param]


@pytest.fixture(params=["zoh", "foh"])
def hold(request) -> str:
    return request.param


@pytest.fixture(params=list(CASES))
def case(request) -> Case:
    return CASES[request.param]


@pytest.fixture
def problem(case) -> Problem:
    """What the estimator has to solve."""
    return case.problem


@pytest.fixture
def build(case, hold) -> Callable[[Problem], AbstractEstimator]:
    """The estimator for a problem."""
    return lambda problem: case.build(problem, Integrator("rk4", 1, hold))


@pytest.fixture
def recursion(build, problem) -> Recursion:
    """The estimator compiled for its problem in the original form."""
    return build(problem).compile(problem.model, DT)


@pytest.fixture
def run(engine) -> Callable[..., dict[str, np.ndarray]]:
    """Outputs by name of an engine's run over u, y, mask from the first sample on."""

    def run(recursion: Recursion, arrays: list[np.ndarray]) -> dict[str, np.ndarray]:
        _, outputs = engine(recursion, arrays, carry=recursion.carry0)
        return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}

    return run
