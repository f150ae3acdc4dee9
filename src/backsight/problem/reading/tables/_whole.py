"""The whole problem file as a table, with noise, estimators and what is written."""

from collections.abc import Mapping
from typing import Any, Literal

import pydantic

from backsight.problem.reading.tables._hits import FollowTable, SearchTable
from backsight.problem.reading.tables._live import DashboardTable, LiveTable, StoreTable
from backsight.problem.reading.tables._recorded import ReadingsTable, RecordingTable
from backsight.problem.reading.tables._strict import ShortTable, StrictTable
from backsight.problem.reading.tables._unknowns import (
    DisturbanceTable,
    DummyTable,
    EstimateTable,
    ForceTable,
    MovingTable,
    VirtualTable,
)


class NoiseTable(StrictTable):
    """``[noise]``: see `backsight.estimators.uncertainty.Noise`."""

    sigma_y: dict[str, float] | None = None
    sigma_w: dict[str, float] | None = None
    R: list[list[float]] | None = None
    Q: list[list[float]] | None = None
    Qc: list[list[float]] | None = None
    sigma_u: dict[str, float] | None = None
    sigma_p: dict[str, float] | None = None
    cross: list[list[float]] | None = None
    outliers: dict[str, Any] | None = None


class PriorTable(StrictTable):
    """``[prior]``: see `backsight.estimators.uncertainty.Prior`."""

    x0: dict[str, float] = pydantic.Field(default_factory=dict)
    sigma_x0: dict[str, float] | None = None
    P0: list[list[float]] | None = None


class EstimatorTable(StrictTable):
    """``[estimators.NAME]``: the method, its own settings, and what it has not in common.

    Parameters
    ----------
    kind : str
        The method, see `backsight methods`.
    smooth : bool
        Smooth: every estimate knows the whole recording.
    follow : table
        Of estimators of unknown forces: find hits one by one in the whole recording.
    search : table
        Of the same: find forces by the whole recording at once; with `locate`, between the places.
    noise, prior : table
        In place of those of the file.
    """

    model_config = pydantic.ConfigDict(extra="allow")

    kind: str
    smooth: bool = False
    follow: FollowTable | None = None
    search: SearchTable | None = None
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


class FreeTable(ShortTable):
    """An entry of ``tune.free``: a value that is found, or options of which one is chosen.

    Parameters
    ----------
    name : str
        What is tuned, such as sigma_y.y.
    spread : float
        How wrong the value in the file may be, as a factor.
    sigma : float
        How wrong it may be, as a standard deviation.
    per : all, recording or list
        Whether recordings share the value.
    structure : scale, diagonal, full or list
        What of Q, Qc or R is free: one factor, the diagonal, everything, or blocks by name.
    options : list
        Values of which one is chosen; parts such as an arrival cost are tables with their `kind`.
    """

    alone = "name"

    name: str
    spread: float | None = None
    sigma: float | None = None
    per: Literal["all", "recording"] | list[str] = "all"
    structure: Literal["scale", "diagonal", "full"] | list[str] = "scale"
    options: list[int | float | str | dict[str, Any]] = pydantic.Field(default_factory=list)


class TuneTable(StrictTable):
    """``[tune]``: what `backsight tune` finds, and what it found last time.

    Parameters
    ----------
    free : list
        What is tuned.
    estimator : str
        For which estimator of the file.
    criterion : table
        What is made as good as possible.
    recordings : list of str
        Files beside that of the problem.
    found : dict
        What was found last time; written by the command.
    """

    free: list[FreeTable] = pydantic.Field(default_factory=list)
    estimator: str | None = None
    criterion: dict[str, Any] = pydantic.Field(default_factory=dict)
    recordings: list[str] = pydantic.Field(default_factory=list)
    found: dict[str, dict[str, Any]] = pydantic.Field(default_factory=dict)


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
    readings : table
        Sensors between the model and its readings.
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
    virtual : dict
        Quantities without a sensor.
    dummy : dict
        Dummy measurements, which are zero.
    tune : table
        What `backsight tune` finds.
    source : dict
        Of `backsight live`: where samples come from.
    live : table
        Of `backsight live`: how they are taken in.
    store : table
        Of `backsight live`: where results are kept.
    alarm : dict
        Of `backsight live`: what is told to people.
    dashboard : table
        Of `backsight live`: the page in the browser.
    sink : dict
        Of `backsight live`: who gets the estimates.
    """

    title: str = ""
    recording: RecordingTable
    model: dict[str, Any]
    estimate: dict[str, EstimateTable] = pydantic.Field(default_factory=dict)
    disturbances: dict[str, DisturbanceTable] = pydantic.Field(default_factory=dict)
    forces: dict[str, ForceTable] = pydantic.Field(default_factory=dict)
    moving: dict[str, MovingTable] = pydantic.Field(default_factory=dict)
    readings: ReadingsTable = ReadingsTable()
    virtual: dict[str, VirtualTable] = pydantic.Field(default_factory=dict)
    dummy: dict[str, DummyTable] = pydantic.Field(default_factory=dict)
    noise: NoiseTable
    prior: PriorTable = PriorTable()
    integrator: dict[str, Any] = pydantic.Field(default_factory=dict)
    estimators: dict[str, EstimatorTable] = pydantic.Field(min_length=1)
    reference: dict[str, float] = pydantic.Field(default_factory=dict)
    tune: TuneTable = TuneTable()
    output: OutputTable = OutputTable()
    source: dict[str, dict[str, Any]] = pydantic.Field(default_factory=dict)
    live: LiveTable = LiveTable()
    store: StoreTable | None = None
    alarm: dict[str, dict[str, Any]] = pydantic.Field(default_factory=dict)
    dashboard: DashboardTable | None = None
    sink: dict[str, dict[str, Any]] = pydantic.Field(default_factory=dict)
