"""An estimator of somebody else's that knows neither noise nor prior."""

import dataclasses
from typing import ClassVar

from backsight.engine.recursion import Recursion
from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model


@dataclasses.dataclass(frozen=True)
class Noiseless(AbstractEstimator):
    """Never compiled: what asks for its noise must refuse it before."""

    key: ClassVar[str] = "noiseless"
    title: ClassVar[str] = "Estimator without noise"

    def build(self, model: Model, dt: float) -> Recursion:
        raise AssertionError((model, dt))
