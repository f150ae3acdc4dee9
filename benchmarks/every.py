"""Every estimator of the package on a plant that it can serve: its cost, not its worth."""

from functools import partial

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import ESTIMATORS
from backsight.testing import CASES, Case
from benchmarks import ours
from benchmarks.contest import Contender, Contest, Entry
from benchmarks.problems import Problem

TITLE = "Every estimator, an oscillator"

SAMPLES, SEED = 4000, 1

STEP = Integrator("rk4", 1)
"""Of those that are not exact."""


def contest() -> Contest:
    """A row for each estimator that is registered, with its case of the contract."""
    entries = (Entry(row(key), partial(_timed, CASES[key])) for key in ESTIMATORS)
    return Contest(
        TITLE,
        "us per sample",
        tuple(entries),
        "The oscillator and the settings of the contract (`backsight.testing`): 2 states, 3 where "
        "the stiffness is estimated, 1 Runge-Kutta step or exact. Native engine, whole recording. "
        "They solve different problems: the table says what each costs.",
    )


def row(key: str) -> str:
    """Row of an estimator: its method, the size of its problem, its horizon if it has one."""
    case = CASES[key]
    problem = case.problem
    N = case.build(problem, STEP).horizon
    sizes = f"{problem.nx} states, {problem.ny} output{'s' * (problem.ny > 1)}"
    return f"{ESTIMATORS[key].title}: {sizes}" + (f", N = {N}" if N else "")


def problem(case: Case) -> Problem:
    """The estimator of a case, with a recording of its plant."""
    on = case.problem
    data = on.simulate(SAMPLES, seed=SEED, hold=STEP.hold, noisy=True)
    return Problem(case.build(on, STEP), on.model, data.recording(on.model))


def _timed(case: Case) -> Contender:
    return ours.machine_code(problem(case))
