"""The whole problem file as a table, its estimators, and what it writes."""

from collections.abc import Mapping
from typing import Any

import pydantic

from backsight.problem.reading.tables import (
    DisturbanceTable,
    EstimateTable,
    ForceTable,
    MovingTable,
    NoiseTable,
    PriorTable,
    RecordingTable,
    StrictTable,
)


class EstimatorTable(StrictTable):
    """``[estimators.NAME]``: the method, its own settings, and what it has not in common.

    Parameters
    ----------
    kind : str
        The method, see `backsight methods`.
    smooth : bool
        Smooth: every estimate knows the whole recording.
    noise, prior : table
        In place of those of the file.
    """

    model_config = pydantic.ConfigDict(extra="allow")

    kind: str
    smooth: bool = False
    noise: NoiseTable | None = None
    prior: PriorTable | None = None

    @property
    def settings(self) -> Mapping[str, Any]:
        """The keys that only this method knows."""
        return self.model_extra or {}


class OutputTable(StrictTable):
    """``[output]``: what is written.

    Parameters
    ----------
    report : bool
        Write the page.
    covariance : bool
        Write the covariance of every sample, ``P``, too.
    """

    report: bool = True
    covariance: bool = False


class ProblemTable(StrictTable):
    """The whole file.

    Parameters
    ----------
    title : str
        Heading of tables and report.
    recording : table
        The file with the measurements.
    model : table
        The equations; `kind` says which.
    estimate : dict
        Parameters that are not known.
    disturbances : dict
        Unknown quantities that are added to the rate of a state.
    forces : dict
        Unknown forces with dynamics.
    moving : dict
        Loads that move along a structure.
    noise, prior : table
        Of all estimators that have none of their own.
    integrator : table
        Of all estimators that take one.
    estimators : dict
        Methods by names of your own.
    reference : dict
        Known value of states and parameters, for errors only [their units].
    output : table
        What is written.
    """

    title: str = ""
    recording: RecordingTable
    model: dict[str, Any]
    estimate: dict[str, EstimateTable] = pydantic.Field(default_factory=dict)
    disturbances: dict[str, DisturbanceTable] = pydantic.Field(default_factory=dict)
    forces: dict[str, ForceTable] = pydantic.Field(default_factory=dict)
    moving: dict[str, MovingTable] = pydantic.Field(default_factory=dict)
    noise: NoiseTable
    prior: PriorTable = PriorTable()
    integrator: dict[str, Any] = pydantic.Field(default_factory=dict)
    estimators: dict[str, EstimatorTable] = pydantic.Field(min_length=1)
    reference: dict[str, float] = pydantic.Field(default_factory=dict)
    output: OutputTable = OutputTable()
