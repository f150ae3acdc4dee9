"""The tables of a problem file: which keys there are and what they hold."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import pydantic


class StrictTable(pydantic.BaseModel):
    """A table with known keys; numbers are finite, and no value is converted to another kind."""

    model_config = pydantic.ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )


class ShortTable(StrictTable):
    """A table that may be given by one of its values alone."""

    alone: ClassVar[str]
    """The key of that value."""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _value_alone(cls, given: Any) -> Any:
        return given if isinstance(given, Mapping | cls) else {cls.alone: given}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        """Allow the value alone beside the table."""
        table = handler.resolve_ref_schema(handler(core))
        return {"anyOf": [dict(table["properties"][cls.alone]), dict(table)]}


class ColumnTable(ShortTable):
    """A column of the file: ``factor * column + offset`` [unit]; its name alone will do."""

    alone = "column"

    column: str
    unit: str = ""
    factor: float | None = None
    offset: float = 0.0
    delay: float = 0.0
    remove_mean: bool = False


class FileTable(StrictTable):
    """A file, its columns and its time."""

    path: str
    source: str = ""
    inputs: dict[str, ColumnTable] = {}
    outputs: dict[str, ColumnTable] = {}
    truth: dict[str, ColumnTable] = {}
    sigma_factor: dict[str, ColumnTable] = {}
    formulas: dict[str, str] = {}
    time: ColumnTable | None = None
    dt: float | None = None
    start: float | None = None
    stop: float | None = None
    resample: float | None = None
    grid: float | None = None
    format: str | None = None
    axis: Literal[0, 1] | None = None
    time_format: str | None = None
    missing: list[float | str] = []
    delimiter: str | None = pydantic.Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] | None = None
    thousands: Literal[".", ",", "'", " "] | None = None
    encoding: str | None = None
    header: int | None = pydantic.Field(default=None, ge=0)
    skip_lines: int = pydantic.Field(default=0, ge=0)


class SourceTable(FileTable):
    """``[recording.sources.NAME]``: a further file, whose clock is late by `delay` [s]."""

    delay: float = 0.0


class RecordingTable(FileTable):
    """``[recording]``: the file, and others that were recorded with it."""

    outputs: dict[str, ColumnTable] = pydantic.Field(min_length=1)
    sources: dict[str, SourceTable] = {}

    @property
    def files(self) -> dict[str, FileTable]:
        """Every file by the key of its table."""
        others = {f"recording.sources.{name}": table for name, table in self.sources.items()}
        return {"recording": self, **others}

    def columns(self, kind: Literal["inputs", "outputs", "truth"]) -> dict[str, ColumnTable]:
        """Columns of all files by signal."""
        return {n: c for table in self.files.values() for n, c in getattr(table, kind).items()}


class EstimateTable(StrictTable):
    """``[estimate.NAME]``: a parameter that is not known."""

    start: float
    sigma: float | None = None
    walk: float = 0.0
    unit: str | None = None
    lower: float | None = None
    upper: float | None = None
    scale: float | None = None
    positive: bool = False


class DisturbanceTable(EstimateTable):
    """``[disturbances.NAME]``: an unknown quantity that is added to the rate of a state."""

    acts_on: str
    start: float = 0.0


class ForceTable(StrictTable):
    """``[forces.NAME]``: an unknown force with dynamics; its other keys are those of the process.

    It is a parameter of the model, or, with `acts_on`, added to the rate of a state.
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
    supports: list[float] = []


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

    x0: dict[str, float] = {}
    sigma_x0: dict[str, float] | None = None
    P0: list[list[float]] | None = None


class EstimatorTable(StrictTable):
    """``[estimators.NAME]``: the method, its own settings, and what it has not in common."""

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
    """``[output]``: what is written."""

    report: bool = True
    covariance: bool = False


class ProblemTable(StrictTable):
    """The whole file."""

    title: str = ""
    recording: RecordingTable
    model: dict[str, Any]
    estimate: dict[str, EstimateTable] = {}
    disturbances: dict[str, DisturbanceTable] = {}
    forces: dict[str, ForceTable] = {}
    moving: dict[str, MovingTable] = {}
    noise: NoiseTable
    prior: PriorTable = PriorTable()
    integrator: dict[str, Any] = {}
    estimators: dict[str, EstimatorTable] = pydantic.Field(min_length=1)
    reference: dict[str, float] = {}
    output: OutputTable = OutputTable()
