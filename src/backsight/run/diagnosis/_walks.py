"""What parameters become if unknown forces walk more or less than was assumed."""

import dataclasses

import numpy as np
import xarray as xr

from backsight.analysis.consistency import log_likelihood
from backsight.analysis.observability import (
    REJECTED,
    STEP,
    Trial,
    WalkDependence,
    flat_directions,
)
from backsight.description import alike
from backsight.errors import BacksightError
from backsight.estimators import yardstick
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.diagnosis._free_forces import constants_and_forces, with_walks
from backsight.run.diagnosis._judges import Judges

MOST_STEPS = 6
"""Steps by a factor of `STEP` that follow the likelihood in one direction."""

ENTRIES = 20_000_000
"""A recording whose covariances have more entries is not gone through again."""


class Walks:
    """Trials with other walks, made once for all estimators that assume the same."""

    def __init__(self, judges: Judges) -> None:
        self._judges = judges
        self._known: list[tuple[AbstractEstimator, WalkDependence | None]] = []

    def doubts(self, estimator: AbstractEstimator, result: xr.Dataset) -> list[str]:
        """Say which parameters of a result are flat, and which rest on the walk of a force."""
        model = self._judges.model
        last = result.isel(time=-1)
        try:
            judge = yardstick(estimator, model)
            noise, prior = judge.assumed
            constants, _ = constants_and_forces(model, noise)
            before = np.sqrt(np.diag(prior.covariance(model)))[constants]
        except BacksightError:
            return []
        x = last["x_hat"].values[constants]
        P = last["P"].values[np.ix_(constants, constants)]
        if not (len(constants) and np.isfinite(x).all() and np.isfinite(P).all()):
            return []
        flat = flat_directions(P, before, [model.states[i] for i in constants])
        found = self._dependence(judge)
        std = np.sqrt(np.maximum(np.diag(P), 0.0))
        return [*flat, *(() if found is None else found.sentences(x, std))]

    def _dependence(self, judge: AbstractEstimator) -> WalkDependence | None:
        for known, found in self._known:
            if alike(known, judge):
                return found
        found = tried(judge, self._judges)
        self._known.append((judge, found))
        return found


def tried(judge: AbstractEstimator, judges: Judges) -> WalkDependence | None:
    """Repeat the estimation with walks that are larger and smaller, as long as that is more likely.

    None if there are no constants beside forces that walk, or the filter diverges as it is.
    """
    noise, _ = judge.assumed
    model = judges.model
    constants, forces = constants_and_forces(model, noise)
    entries = judges.recording.sizes["time"] * model.nx**2
    if not (len(constants) and len(forces)) or entries > ENTRIES:
        return None

    def trial(factor: float) -> Trial | None:
        walks = with_walks(noise, model, forces=forces, factor=factor)
        result = judges.trial(dataclasses.replace(judge, noise=walks))
        return None if result is None else _trial(result, constants, factor)

    as_it_is = judges.result(judge)
    assumed = None if as_it_is is None else _trial(as_it_is, constants, 1.0)
    if assumed is None:
        return None
    others: list[Trial] = []
    for step in (1 / STEP, STEP):
        best, factor = assumed, step
        for _ in range(MOST_STEPS):
            found = trial(factor)
            if found is None:
                break
            others.append(found)
            if found.log_likelihood - best.log_likelihood < REJECTED:
                break
            best, factor = found, factor * step
    return WalkDependence(
        parameters=_names(model, constants),
        forces=_names(model, forces),
        assumed=assumed,
        others=tuple(others),
    )


def _trial(result: xr.Dataset, constants: list[int], factor: float) -> Trial | None:
    """What a result says at its end; None if that is not finite."""
    last = result.isel(time=-1)
    x, std = last["x_hat"].values[constants], last["x_std"].values[constants]
    likelihood = float(log_likelihood(result).sum())
    finite = np.isfinite([*x, *std, likelihood]).all()
    return Trial(factor, likelihood, x, std) if finite else None


def _names(model: Model, places: list[int]) -> tuple[str, ...]:
    return tuple(model.states[i].name for i in places)
