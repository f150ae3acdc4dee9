"""What an estimator of unknown forces may do with a whole recording."""

from typing import Annotated, Any, TypedDict

import pydantic

from backsight.problem.reading.tables._strict import StrictTable


class FollowSettings(TypedDict):
    """What `backsight.forces.follow_hits` takes beside estimator, model and recording."""

    sizes: tuple[float, float]
    before: int
    after: int
    beside: tuple[str, ...]
    alarm: float
    gain: float


class FollowTable(StrictTable):
    """``[estimators.NAME.follow]``: hits one by one, by the equations themselves.

    Parameters
    ----------
    sizes : list of two float
        Smallest and largest height of a pulse that is tried [unit of the forces].
    before, after : int
        Samples of a window before and after an alarm.
    beside : list of str
        Forces that a hit may move at the same time, wherever it is; they are no places.
    alarm : float
        Mean of the squared innovations, by their variances, over a pulse, at which it is looked for
        a hit; 1 if nothing happens.
    gain : float
        Share of what a window leaves without a hit that one must explain to be believed.
    """

    sizes: list[Annotated[float, pydantic.Field(gt=0)]] = pydantic.Field(min_length=2, max_length=2)
    before: int = pydantic.Field(ge=1)
    after: int = pydantic.Field(ge=1)
    beside: list[str] = pydantic.Field(default_factory=list)
    alarm: float = pydantic.Field(default=10.0, gt=0)
    gain: float = pydantic.Field(default=0.5, gt=0, le=1)

    @property
    def settings(self) -> FollowSettings:
        """Keywords of `backsight.forces.follow_hits`."""
        low, high = self.sizes
        return {
            "sizes": (low, high),
            "before": self.before,
            "after": self.after,
            "beside": tuple(self.beside),
            "alarm": self.alarm,
            "gain": self.gain,
        }


class LineTable(StrictTable):
    """``line``: where the forces are along a line, see `ForceLine`.

    Parameters
    ----------
    places : list of float
        Position of every force [m], in the order of `forces`.
    supports : list of float
        Positions at which the structure does not move [m].
    """

    places: list[float] = pydantic.Field(min_length=1)
    supports: list[float] = pydantic.Field(default_factory=list)


class SearchTable(StrictTable):
    """``[estimators.NAME.search]``: all forces, by the whole recording at once.

    Parameters
    ----------
    selection : table
        How forces are chosen; `kind` is Greedy, GreedyGroups, Reweighted or L1, see
        `find_sparse_forces`.
    locate : bool
        Fit hits between the places and the samples, see `locate_hits`.
    line : table
        Where the places are, for `locate`.
    """

    selection: dict[str, Any] = pydantic.Field(default_factory=dict)
    locate: bool = False
    line: LineTable | None = None
