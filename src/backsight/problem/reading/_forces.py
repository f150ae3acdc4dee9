"""Unknown forces with dynamics, and loads that move, as a problem file describes them."""

import dataclasses
from collections.abc import Mapping

from backsight.description import Description, Positive
from backsight.errors import ProblemError, nearest
from backsight.models.forces.moving_load import moving_load
from backsight.models.forces.processes import GaussMarkov, Matern, Periodic, Process
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.problem.reading.checking import at
from backsight.problem.reading.settings import built
from backsight.problem.reading.tables import ForceTable, ProblemTable

PROCESSES = {"matern": Matern, "periodic": Periodic}
"""Forces with dynamics by the word of the key ``kind``; ``gauss_markov`` is one of Matérn's."""


def process_of(name: str, entry: ForceTable) -> Process:
    """The process that an entry of ``[forces]`` describes."""
    where = f"forces.{name}"
    if entry.kind == "gauss_markov":
        return built(_GaussMarkov, entry.settings, where=where, fixed={}).process()
    if entry.kind not in PROCESSES:
        hint = nearest(entry.kind, [*PROCESSES, "gauss_markov"])
        raise ProblemError(f"{where}.kind: unknown kind '{entry.kind}', {hint}")
    return built(PROCESSES[entry.kind], entry.settings, where=where, fixed={})


@dataclasses.dataclass(frozen=True)
class _GaussMarkov(Description):
    """The keys of ``kind = "gauss_markov"``."""

    sigma: Positive
    time: Positive

    def process(self) -> Process:
        return GaussMarkov(self.sigma, self.time)


def of_mean(group: tuple[Signal, ...], entries: Mapping[str, ForceTable]) -> tuple[Signal, ...]:
    """Signals with the mean of their force as their value."""
    return tuple(
        dataclasses.replace(s, value=entries[s.name].mean, unit=entries[s.name].unit or s.unit)
        if s.name in entries
        else s
        for s in group
    )


def with_moving(model: Model, table: ProblemTable) -> Model:
    """The model with the loads of ``[moving]``."""
    for name, entry in table.moving.items():
        with at(f"moving.{name}"):
            model = moving_load(
                model, name, position=entry.position, along=entry.along, supports=entry.supports
            )
    return model
