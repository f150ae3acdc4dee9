"""One setting after the other, each with a recursion of its own: for all estimators and values."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from backsight.engine.execute import run_recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.run.estimation import run_on
from backsight.run.estimation.lag import from_first_sample
from backsight.tune.fitting._lanes import Data, decorrelated
from backsight.tune.fitting.values import Unknown, placed
from backsight.types import Array

COMPILE = 5000
"""Samples from which on machine code is compiled for every setting."""


@dataclasses.dataclass(frozen=True)
class Rebuilt:
    """An estimator that is built anew for every setting.

    Parameters
    ----------
    estimator, model : AbstractEstimator, Model
    unknowns : tuple of Unknown
    dt : float
    """

    estimator: AbstractEstimator
    model: Model
    unknowns: tuple[Unknown, ...]
    dt: float

    def innovations(
        self, data: Data, settings: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[Array, Array]]:
        """Innovations and their variances (lanes, n, ny) with every setting, in one piece.

        Those of estimators that look back are of the predictions that they make when a sample is
        the newest, where they say so, else of the sample that the output is about.
        """
        found = [self._alone(data, values) for values in settings]
        yield np.stack([r for r, _ in found]), np.stack([d for _, d in found])

    def _alone(self, data: Data, values: Mapping[str, float]) -> tuple[Array, Array]:
        u, y, mask, y_all, mask_all = data
        estimator, model = placed(self.estimator, self.model, self.unknowns, values)
        recursion = estimator.compile(model, self.dt)
        engine = "vm" if len(u) < COMPILE else "native"
        outputs = run_recursion(recursion, run_on([u, y, mask], recursion.lag), engine=engine)
        shown = from_first_sample(outputs, recursion.lag)
        named = dict(zip([c.name for c in recursion.channels], shown, strict=True))
        if not {"e", "S", "y_hat"} <= set(named):
            raise TuningError(f"{estimator.title} puts out no innovations to be judged by")
        R = _measurement(estimator, model)
        rows = [named["e"], named["S"], named["y_hat"], y_all, mask, mask_all, np.ones_like(y)]
        r, d = decorrelated(R).map(len(u))(*(a.T for a in rows))
        return np.asarray(r).T, np.asarray(d).T


def _measurement(estimator: AbstractEstimator, model: Model) -> Array:
    try:
        return estimator.assumed[0].measurement(model)
    except TuningError:
        return np.zeros((model.ny, model.ny))
