"""The tables inside a problem file: which keys there are and what they hold."""

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
    """A column of the file: ``factor * column + offset`` [unit]; its name alone will do.

    Parameters
    ----------
    column : str
        Name in the file; ``group/name``, ``acc[2]``, see `backsight.data.Column`.
    unit : str
        In which the signal is wanted; the column is converted if the file says its unit.
    factor : float
        From the number in the file to the unit; it is all the conversion there is then.
    offset : float
        Added after `factor` [unit].
    delay : float
        By which the column is late [s]; fractions of a sample are interpolated.
    remove_mean : bool
        Subtract the mean over the samples that are kept.
    """

    alone = "column"

    column: str
    unit: str = ""
    factor: float | None = None
    offset: float = 0.0
    delay: float = 0.0
    remove_mean: bool = False


class FileTable(StrictTable):
    """A file, its columns and its time.

    Parameters
    ----------
    path : str
        Relative to the problem file; ``${NAME}`` is an environment variable.
    source : str
        Where to get the file, told when it is missing.
    inputs, outputs : dict
        Signal of the model to its column.
    truth : dict
        State to the column with its true values, for comparison only.
    sigma_factor : dict
        Output to a column of standard deviations of its samples, by `sigma_y`.
    formulas : dict
        Further column to the formula that makes it of others.
    time : column
        Of time stamps [s], or dates; not needed if the file knows its times, or with `dt`.
    dt : float
        Sampling period [s].
    start, stop : float
        Samples with ``start <= t < stop`` are kept [s].
    resample : float
        Sampling period to which the samples are interpolated [s].
    grid : float
        Sampling period of an even grid; nothing is measured between the samples [s].
    format : str
        How to read the file whatever it is called: text, or a suffix as mat.
    axis : 0 or 1
        Of matrices along which time runs.
    time_format : str
        How dates are written, as in strptime, or excel, matlab, unix, unix_ms, ros.
    missing : list
        Values that stand for "not measured".
    delimiter, decimal, thousands, encoding : str
        Of texts: what separates cells, the signs in numbers, the encoding.
    header : int
        Of texts: number of the line with the names, from 1 on; 0: there is none.
    skip_lines : int
        Of texts: lines to pass over at the top.
    """

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
    """``[recording.sources.NAME]``: a further file, whose clock is late by `delay` [s].

    Parameters
    ----------
    delay : float
        By which the clock of this file is late [s].
    """

    delay: float = 0.0


class RecordingTable(FileTable):
    """``[recording]``: the file, and others that were recorded with it.

    Parameters
    ----------
    sources : dict
        Further files by names of your own.
    """

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
        Class of the process in `backsight.forces`: Matern, GaussMarkov, Periodic, ...
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
