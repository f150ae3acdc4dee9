"""Ways to run an estimator with other values.

By matrices alone, all at once in lanes, or built anew for each.
"""

from collections.abc import Sequence

from backsight.estimators.base import AbstractEstimator
from backsight.models.model import Model
from backsight.tune.fitting.runners._delays import delays_of as delays_of
from backsight.tune.fitting.runners._exactly_linear import MANY, updates_of
from backsight.tune.fitting.runners._exactly_linear import LinearRunner as LinearRunner
from backsight.tune.fitting.runners._exactly_linear import linear_runner as linear_runner
from backsight.tune.fitting.runners._lanes import Data as Data
from backsight.tune.fitting.runners._lanes import LaneRunner as LaneRunner
from backsight.tune.fitting.runners._lanes import able_settings as able_settings
from backsight.tune.fitting.runners._lanes import lanes_of as lanes_of
from backsight.tune.fitting.runners._rebuilt import Rebuilt as Rebuilt
from backsight.tune.fitting.runners._wide import opened_to_inputs as opened_to_inputs
from backsight.tune.fitting.values import Unknown


def quick_runner(
    estimator: AbstractEstimator,
    model: Model,
    dt: float,
    unknowns: Sequence[Unknown],
    *,
    data: Sequence[Data],
    ahead: int = 0,
) -> LinearRunner | LaneRunner | None:
    """The quickest runner of recordings for which all values are plain numbers; None if none is."""
    few = sum(map(updates_of, data)) <= MANY
    by_matrices = linear_runner(estimator, model, dt, unknowns) if few and not ahead else None
    return by_matrices or lanes_of(estimator, model, dt, unknowns, ahead=ahead)
