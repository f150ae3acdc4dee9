"""One setting after the other, each with a recursion of its own: for all estimators and values."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from backsight.engine.execute import run_recursion
from backsight.errors import TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.parts.covariance import packed
from backsight.models.model import Model
from backsight.run.estimation import run_on
from backsight.run.estimation.carrying import from_first_sample
from backsight.tune.fitting.runners._delays import shifted
from backsight.tune.fitting.runners._foresight import foresight, with_foresight
from backsight.tune.fitting.runners._lanes import Data, decorrelated
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
    ahead : int
        See `lanes_of`.
    """

    estimator: AbstractEstimator
    model: Model
    unknowns: tuple[Unknown, ...]
    dt: float
    ahead: int = 0

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
        u = shifted(u, self.model, self.dt, self.unknowns, values)
        estimator, model = placed(self.estimator, self.model, self.unknowns, values)
        recursion = estimator.compile(model, self.dt)
        engine = "vm" if len(u) < COMPILE else "native"
        outputs = run_recursion(recursion, run_on([u, y, mask], recursion.lag), engine=engine)
        shown = from_first_sample(outputs, recursion.lag)
        named = dict(zip([c.name for c in recursion.channels], shown, strict=True))
        if self.ahead:
            return self._foreseen(estimator, model, named["x_hat"], (u, y_all, mask_all))
        if not {"e", "S", "y_hat"} <= set(named):
            raise TuningError(f"{estimator.title} puts out no innovations to be judged by")
        R = np.tile(packed(_measurement(estimator, model)), (len(u), 1))
        rows = [named["e"], named["S"], named["y_hat"], y_all, mask, mask_all, np.ones_like(y), R]
        r, d = decorrelated(model.ny).map(len(u))(*(a.T for a in rows))
        return np.asarray(r).T, np.asarray(d).T

    def _foreseen(
        self, estimator: AbstractEstimator, model: Model, x: Array, data: tuple[Array, ...]
    ) -> tuple[Array, Array]:
        """What the model by itself makes of every estimate; variances of 1."""
        if estimator.delay:
            raise TuningError(
                f"{estimator.title} looks back over {estimator.delay} samples: its estimates know "
                "what is to be predicted; judge it with lag = 0"
            )
        bends = any(u.kind == "parameter" for u in self.unknowns)
        method = estimator.varied(parameters=bends)
        look = foresight(method, model, self.dt, self.ahead)
        recursion = with_foresight(model, look, self.dt)
        (r,) = run_recursion(recursion, [x, *data], engine="native")
        return r, np.ones_like(r)


def _measurement(estimator: AbstractEstimator, model: Model) -> Array:
    try:
        return estimator.assumed[0].measurement(model, singular=True)
    except TuningError:
        return np.zeros((model.ny, model.ny))
