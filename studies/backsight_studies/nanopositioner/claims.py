"""What the paper says of its observer, each statement decided by the measured numbers."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

from backsight_studies.nanopositioner.evaluate import Measures
from backsight_studies.nanopositioner.experiment import Experiment
from backsight_studies.nanopositioner.plant import DT, WITH_PAYLOAD, WITHOUT_PAYLOAD
from backsight_studies.nanopositioner.tuning import CONVERGED, HORIZON, PAPER_RULE

EKF, A, B = "EKF", "MHOa", "MHOb"


@dataclasses.dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Parameters
    ----------
    text : str
    short : str
        The same in a few words.
    holds : callable
        ``{method: Measures} -> bool`` on one recording.
    shown : tuple of str
        Fields of `Measures` that it is about.
    """

    text: str
    short: str
    holds: Callable[[Mapping[str, Measures]], bool]
    shown: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Verdict:
    """On how many recordings of a scenario a claim holds, with one solver."""

    claim: Claim
    scenario: str
    solver: str
    holds: int
    of: int
    numbers: str

    @property
    def passed(self) -> bool:
        """Whether it holds on all of them."""
        return self.holds == self.of


def _ordered(field: str) -> Callable[[Mapping[str, Measures]], bool]:
    return lambda m: getattr(m[A], field) < getattr(m[B], field) < getattr(m[EKF], field)


def _smaller(field: str, one: str, other: str) -> Callable[[Mapping[str, Measures]], bool]:
    return lambda m: _never_last(getattr(m[one], field)) < _never_last(getattr(m[other], field))


def _all_larger(fields: Sequence[str]) -> Callable[[Mapping[str, Measures]], bool]:
    return lambda m: all(getattr(m[A], f) > getattr(m[B], f) for f in fields)


def _never_last(value: float) -> float:
    """A convergence time of NaN means "never"."""
    return math.inf if math.isnan(value) else value


STEPS = ("step_k", "step_b", "step_c")
SPREADS = ("std_k", "std_b", "std_c")

CLAIMS = (
    Claim(
        "RSE of the displacement: MHOa < MHOb < EKF (Table I)",
        "order of RSE x1",
        _ordered("rse_x1"),
        ("rse_x1",),
    ),
    Claim(
        "RSE of the speed: MHOa < MHOb < EKF (Table I)",
        "order of RSE x2",
        _ordered("rse_x2"),
        ("rse_x2",),
    ),
    Claim(
        "After the removal k/m converges faster with MHOa than with the EKF",
        "faster with MHOa",
        _smaller("k_time", A, EKF),
        ("k_time",),
    ),
    Claim(
        "After the removal k/m converges faster with MHOb than with the EKF",
        "faster with MHOb",
        _smaller("k_time", B, EKF),
        ("k_time",),
    ),
    Claim(
        "During the transient MHOa gives the speed more accurately than the EKF",
        "speed in the transient, MHOa",
        _smaller("rms_v_transient", A, EKF),
        ("rms_v_transient",),
    ),
    Claim(
        "During the transient MHOb gives the speed more accurately than the EKF",
        "speed in the transient, MHOb",
        _smaller("rms_v_transient", B, EKF),
        ("rms_v_transient",),
    ),
    Claim(
        "All parameters of MHOa vary more than those of MHOb, from sample to sample",
        "steps of the parameters",
        _all_larger(STEPS),
        STEPS,
    ),
    Claim(
        "All parameters of MHOa scatter more than those of MHOb, once settled",
        "scatter of the parameters",
        _all_larger(SPREADS),
        SPREADS,
    ),
    Claim(
        "MHOb takes less computing than MHOa",
        "computing",
        _smaller("evaluations", B, A),
        ("evaluations",),
    ),
)
"""From the abstract and section VI.E."""

NAMES = {
    "rse_x1": "RSE x1 [µm]",
    "rse_x2": "RSE x2 [µm/s]",
    "k_time": "time [ms]",
    "rms_v_transient": "error [µm/s]",
    "step_k": "k",
    "step_b": "b",
    "step_c": "c",
    "std_k": "k",
    "std_b": "b",
    "std_c": "c",
    "evaluations": "evaluations per sample",
}


def judge(experiment: Experiment) -> list[Verdict]:
    """Decide every claim in every scenario for both solvers."""
    return [
        _verdict(claim, scenario, solver, experiment)
        for claim in CLAIMS
        for scenario in experiment.scenarios
        for solver in (CONVERGED, PAPER_RULE)
    ]


def periods_in_window() -> tuple[float, float]:
    """Horizon in periods of oscillation, with and without the payload; the paper says one."""
    with_, without = (
        HORIZON * DT * math.sqrt(p["k"]) / (2 * math.pi) for p in (WITH_PAYLOAD, WITHOUT_PAYLOAD)
    )
    return with_, without


def _verdict(claim: Claim, scenario: str, solver: str, experiment: Experiment) -> Verdict:
    trials = [
        {EKF: m[EKF]} | {method: m[f"{method}, {solver}"] for method in (A, B)}
        for m in experiment.trials(scenario)
    ]
    return Verdict(
        claim=claim,
        scenario=scenario,
        solver=solver,
        holds=sum(claim.holds(m) for m in trials),
        of=len(trials),
        numbers="; ".join(_numbers(field, trials) for field in claim.shown),
    )


def _numbers(field: str, trials: Sequence[Mapping[str, Measures]]) -> str:
    means = {
        method: sum(getattr(m[method], field) for m in trials) / len(trials)
        for method in (EKF, A, B)
    }
    known = [f"{method} {_number(v)}" for method, v in means.items() if not math.isnan(v)]
    never = [method for method, v in means.items() if math.isnan(v) and field == "k_time"]
    return f"{NAMES[field]}: " + ", ".join(known + [f"{method} not always" for method in never])


def _number(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
