"""What is unknown: parameters, disturbances, forces, quantities without a sensor."""

from collections.abc import Mapping
from typing import Any

import pydantic

from backsight.problem.reading.tables._strict import ShortTable, StrictTable


class EstimateTable(StrictTable):
    """``[estimate.NAME]``: a parameter that is not known.

    Parameters
    ----------
    start : float
        The guess [unit].
    sigma : float
        How wrong the guess may be: a standard deviation [unit].
    walk : float
        Standard deviation of its change from sample to sample; 0: it is constant [unit].
    unit : str
        Shown in results; that of the model's parameter if not given.
    lower, upper : float
        Bounds that the estimate keeps [unit].
    scale : float
        Size by which steps and derivatives are measured [unit].
    positive : bool
        The logarithm is estimated, so that it stays positive.
    """

    start: float
    sigma: float | None = None
    walk: float = 0.0
    unit: str | None = None
    lower: float | None = None
    upper: float | None = None
    scale: float | None = None
    positive: bool = False


class GapsTable(EstimateTable):
    """``gaps`` of an input: it is a state with a walk, which the column measures to `sigma_u`.

    Parameters
    ----------
    sigma_u : float
        Standard deviation of the column where it is there [unit].
    """

    start: float = 0.0
    sigma_u: float


class DisturbanceTable(EstimateTable):
    """``[disturbances.NAME]``: an unknown quantity that is added to the rate of a state.

    Parameters
    ----------
    acts_on : str
        State to whose rate it is added.
    """

    acts_on: str
    start: float = 0.0


class ForceTable(StrictTable):
    """``[forces.NAME]``: an unknown force with dynamics; its other keys are those of the process.

    It is a parameter of the model, or, with `acts_on`, added to the rate of a state.

    Parameters
    ----------
    kind : str
        The process: matern, gauss_markov, periodic and others of `backsight.forces`.
    acts_on : str
        State to whose rate it is added.
    mean : float
        Around which it varies [unit].
    unit : str
        That of the model's parameter if not given.
    """

    model_config = pydantic.ConfigDict(extra="allow")

    kind: str
    acts_on: str | None = None
    mean: float = 0.0
    unit: str | None = None

    @property
    def settings(self) -> Mapping[str, Any]:
        """The keys that only this process knows."""
        return self.model_extra or {}


class MovingTable(StrictTable):
    """``[moving.NAME]``: a load along forces of a structure, see `backsight.forces.moving_load`."""

    position: str
    along: dict[str, float] = pydantic.Field(min_length=1)
    supports: list[float] = pydantic.Field(default_factory=list)


class VirtualTable(ShortTable):
    """``[virtual.NAME]``: a quantity without a sensor; its formula alone will do.

    Either a formula, or a kind and a place as of a sensor of the structure.

    Parameters
    ----------
    expression : str
        Formula of states, inputs and parameters.
    kind : str
        As of a sensor of the structure: displacement, velocity, acceleration, strain.
    at : place
        Where, as of a sensor of the structure.
    unit : str
        Shown in results.
    """

    alone = "expression"

    expression: str | None = None
    kind: str | None = None
    at: Any = None
    unit: str = ""

    @property
    def placed(self) -> bool:
        """Whether it is described like a sensor."""
        return self.kind is not None or self.at is not None


class DummyTable(VirtualTable):
    """``[dummy.NAME]``: a dummy measurement, that is zero to `sigma` in every sample.

    Parameters
    ----------
    sigma : float
        How far from zero it is: a standard deviation [unit].
    """

    sigma: float | None = None
