"""What conditions of alarms see, and the quantities of rows by name."""

import abc
import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from backsight.errors import ProblemError, nearest
from backsight.live.engine import LiveRows
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Sighting:
    """What a condition sees in new samples.

    Parameters
    ----------
    there : bool
        Whether it is there.
    over : bool
        Whether it is surely over; between the two nothing changes.
    sentence : str
    value : float, optional
    place : float, optional
        Where along the structure [m].
    """

    there: bool
    over: bool
    sentence: str
    value: float | None = None
    place: float | None = None


class Condition(abc.ABC):
    """What an alarm looks at."""

    @abc.abstractmethod
    def see(self, rows: LiveRows) -> Sighting | None:
        """Look at new samples; None if they say nothing."""


class Quantities:
    """Quantities of rows by name: states, virtual ones, forces, outputs.

    Parameters
    ----------
    model : Model
    labels : dict
        Names along dimensions of the estimator's own, by variable.
    """

    def __init__(self, model: Model, labels: Mapping[str, Sequence[str]]) -> None:
        self._places: dict[str, tuple[str, str, int]] = {}
        self.units: dict[str, str] = {}
        units = {s.name: s.unit for s in model.parameters}
        self.positions = {s.name: s.position for s in model.parameters}
        for k, s in reversed(list(enumerate(model.outputs))):
            self._set(s.name, ("y_hat", "", k), s.unit)
        for hat, std in (("z_hat", "z_std"), ("d_hat", "d_std")):
            for k, name in enumerate(labels.get(hat, ())):
                self._set(name, (hat, std, k), units.get(name, ""))
        for k, s in enumerate(model.states):
            self._set(s.name, ("x_hat", "x_std", k), s.unit)
        self.forces = list(labels.get("d_hat", ())) or [*model.resting]

    def _set(self, name: str, place: tuple[str, str, int], unit: str) -> None:
        self._places[name], self.units[name] = place, unit

    def check(self, names: Sequence[str], where: str) -> None:
        """Raise `ProblemError` if there is no such quantity."""
        for name in names:
            if name not in self._places:
                raise ProblemError(
                    f"{where}.of: there is no quantity '{name}', {nearest(name, self._places)}"
                )

    def has_band(self, rows: LiveRows, name: str) -> bool:
        """Whether a standard deviation is known."""
        return self._places[name][1] in rows.values

    def of(self, rows: LiveRows, name: str) -> tuple[Array, Array]:
        """Values and standard deviations, (n,) each."""
        hat, std, k = self._places[name]
        values = rows.values[hat][:, k]
        spread = rows.values[std][:, k] if std in rows.values else np.zeros(len(values))
        return values, spread
