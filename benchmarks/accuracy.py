"""Errors of estimators side by side, on the same data from the same start."""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from backsight.engine import native
from backsight.estimators import EKF, ConstantArrival, SmoothedArrival
from backsight.types import Array
from benchmarks import process_noise
from benchmarks.contest import clock, peer, reason
from benchmarks.process_noise import INACTIVE
from benchmarks.stage import PRIOR, STEPPING

SAMPLES, FROM = 500, 200
"""Length of the recording, and the first sample that is judged."""

JUDGED = {"v": "speed", "k": "stiffness", "b": "damping", "c": "gain"}


@dataclasses.dataclass(frozen=True)
class Accuracy:
    """Errors of an estimator.

    Parameters
    ----------
    name : str
    errors : dict
        Root mean square of the errors by name, as a share of that of the true values.
    time : float
        Of the only run [us per sample].
    failure : str
        Why there are no errors, if there are none.
    """

    name: str
    errors: dict[str, float]
    time: float
    failure: str = ""

    def record(self) -> dict[str, Any]:
        """One row of a table."""
        errors = {name: self.errors.get(name, np.nan) for name in JUDGED.values()}
        return {"name": self.name, **errors, "time": self.time, "failure": self.failure}


def accuracies() -> list[Accuracy]:
    """Moving horizon estimation with process noise, bounds that are inactive."""
    of = process_noise.problem(INACTIVE)
    mhe = of.estimator
    arrivals = {"constant": ConstantArrival(), "smoothed": SmoothedArrival()}
    ours = {
        f"Backsight, moving horizon, {name} arrival cost": dataclasses.replace(mhe, arrival=arrival)
        for name, arrival in arrivals.items()
    }
    ours["Backsight, extended Kalman filter"] = EKF(
        STEPPING, PRIOR, process_noise.HEUN, covariance="discrete"
    )
    return [
        _judged(
            "do-mpc, its own (constant) arrival cost",
            peer("do_mpc_noise", "whole", INACTIVE, SAMPLES),
        ),
        *(_judged(name, lambda e=estimator: _native(e)) for name, estimator in ours.items()),
    ]


def _native(estimator: Any) -> Callable[[], Array]:
    of = dataclasses.replace(process_noise.problem(INACTIVE), estimator=estimator)
    data = [d[:SAMPLES] for d in of.data]
    native.compiled(of.recursion)
    return lambda: native.run(of.recursion, data, carry=of.recursion.carry0)[1][0]


def _judged(name: str, build: Callable[[], Callable[[], Array]]) -> Accuracy:
    found = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of libraries that are not ours
            work = build()
            spent, _ = clock(lambda: found.append(work()))
    except Exception as error:
        return Accuracy(name, {}, np.nan, reason(error))
    of = process_noise.problem(INACTIVE)
    truth = of.recording["x_true"].sel(state=list(JUDGED)).values[FROM:SAMPLES]
    states = [s.name for s in of.model.states]
    columns = [states.index(state) for state in JUDGED]
    errors = np.sqrt(np.mean((found[0][FROM:, columns] - truth) ** 2, axis=0))
    shares = errors / np.sqrt(np.mean(truth**2, axis=0))
    named = dict(zip(JUDGED.values(), map(float, shares), strict=True))
    return Accuracy(name, named, 1e6 * spent / SAMPLES)
