"""Where the measurements are: files, columns, clocks."""

from collections.abc import Mapping
from typing import Annotated, Literal

import pydantic

from backsight.problem.reading.tables._strict import ShortTable, StrictTable
from backsight.problem.reading.tables._unknowns import GapsTable


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


class CommandColumnTable(ColumnTable):
    """A column of an input, which may have gaps.

    Parameters
    ----------
    gaps : table
        How the input goes on where it was not recorded.
    """

    gaps: GapsTable | None = None


class SensorColumnTable(ColumnTable):
    """A column of an output, with what is known of its sensor.

    Parameters
    ----------
    wrap : float or str
        Range after which the sensor begins anew: 360, or 2*pi [unit].
    resolution : float
        Smallest step of the sensor; its variance is added to R [unit].
    saturation : list of two float
        Ends of the range of the sensor, -inf or inf where there is none; readings there count as
        not measured [unit].
    """

    wrap: float | str | None = None
    resolution: float | None = None
    saturation: list[Annotated[float, pydantic.AllowInfNan(True)]] | None = pydantic.Field(
        default=None, min_length=2, max_length=2
    )


class ReadingTable(StrictTable):
    """``[readings.outputs.NAME]``: the sensor of an output, see `with_sensors`.

    Parameters
    ----------
    limit : float
        Beyond plus or minus this nothing is seen, before the low-pass [unit of the output].
    cutoff : float
        Of a low-pass of the first order [Hz].
    late : float
        By which the channel is read after the sample [s].
    gain, offset : float
        Makes a parameter NAME_gain, NAME_offset, which may be estimated.
    """

    limit: float | None = None
    cutoff: float | None = None
    late: float = 0.0
    gain: float | None = None
    offset: float | None = None


class ReadingsTable(StrictTable):
    """``[readings]``: sensors between a model and its readings.

    Parameters
    ----------
    dt : float
        Sampling period [s]; the motion of a linear model is then exact between the samples.
    parts : int
        Of a sample, with dt: between them limit and low-pass see straight lines.
    outputs : dict
        Names of outputs to their sensors.
    """

    dt: float | None = None
    parts: int = 8
    outputs: dict[str, ReadingTable] = pydantic.Field(default_factory=dict)


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
    inputs: dict[str, CommandColumnTable] = pydantic.Field(default_factory=dict)
    outputs: dict[str, SensorColumnTable] = pydantic.Field(default_factory=dict)
    truth: dict[str, ColumnTable] = pydantic.Field(default_factory=dict)
    sigma_factor: dict[str, ColumnTable] = pydantic.Field(default_factory=dict)
    formulas: dict[str, str] = pydantic.Field(default_factory=dict)
    time: ColumnTable | None = None
    dt: float | None = None
    start: float | None = None
    stop: float | None = None
    resample: float | None = None
    grid: float | None = None
    format: str | None = None
    axis: Literal[0, 1] | None = None
    time_format: str | None = None
    missing: list[float | str] = pydantic.Field(default_factory=list)
    delimiter: str | None = pydantic.Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] | None = None
    thousands: Literal[".", ",", "'", " "] | None = None
    encoding: str | None = None
    header: int | None = pydantic.Field(default=None, ge=0)
    skip_lines: int = pydantic.Field(default=0, ge=0)

    @property
    def with_gaps(self) -> Mapping[str, GapsTable]:
        """Inputs that were not recorded at every sample."""
        return {name: c.gaps for name, c in self.inputs.items() if c.gaps is not None}


class SourceTable(FileTable):
    """``[recording.sources.NAME]``: a further file, whose clock is late by `delay` [s].

    Parameters
    ----------
    delay : float
        By which the clock of this file is late [s].
    """

    delay: float = 0.0


class PartsTable(StrictTable):
    """``[recording.parts]``: a recording that need not fit into memory, part by part.

    Parameters
    ----------
    samples : int
        Samples of a part of one file; of a folder or a pattern every file is a part.
    variables : list of str
        What is kept of the results, as of `backsight.large.Outputs`; all of it if not given.
    every : int
        Every so many samples are kept.
    dtype : float64 or float32
        How numbers are stored.
    """

    samples: int = pydantic.Field(default=1_000_000, ge=2)
    variables: list[str] | None = None
    every: int = pydantic.Field(default=1, ge=1)
    dtype: Literal["float64", "float32"] = "float64"


class RecordingTable(FileTable):
    """``[recording]``: the file, and others that were recorded with it.

    Parameters
    ----------
    sources : dict
        Further files by names of your own.
    high_pass : float
        Corner frequency of a high-pass that is taken of inputs and outputs alike [Hz].
    parts : table
        Read and estimate part by part; `path` may be a folder or a pattern then.
    """

    outputs: dict[str, SensorColumnTable] = pydantic.Field(min_length=1)
    sources: dict[str, SourceTable] = pydantic.Field(default_factory=dict)
    high_pass: float | None = None
    parts: PartsTable | None = None

    @property
    def gaps(self) -> dict[str, GapsTable]:
        """Inputs of all files that were not recorded at every sample."""
        return {n: g for table in self.files.values() for n, g in table.with_gaps.items()}

    @property
    def files(self) -> dict[str, FileTable]:
        """Every file by the key of its table."""
        others = {f"recording.sources.{name}": table for name, table in self.sources.items()}
        return {"recording": self, **others}

    def columns(self, kind: Literal["inputs", "outputs", "truth"]) -> dict[str, ColumnTable]:
        """Columns of all files by signal."""
        return {n: c for table in self.files.values() for n, c in getattr(table, kind).items()}
