"""The tables of a fleet file."""

from typing import Any, Literal

import pydantic

from backsight.problem.reading.tables import StrictTable


class RecordingsTable(StrictTable):
    """``[recordings]``: which ones, and what is known of each.

    Parameters
    ----------
    files : str or list of str
        Pattern such as ``runs/*.csv``, or several; relative to the fleet file.
    table : str
        A table with a row for each recording: CSV, XLSX or Parquet.
    file : str
        Column of the table with the path of the recording.
    settings : dict
        Key of the problem file to the column of the table with its value for each recording.
    """

    files: str | list[str] = pydantic.Field(default_factory=list)
    table: str | None = None
    file: str = "file"
    settings: dict[str, str] = pydantic.Field(default_factory=dict)


class KeepTable(StrictTable):
    """``[keep]``: what is written of each recording beside its row; see `Outputs`.

    Parameters
    ----------
    variables : list of str
        Variables of the results, as of `backsight.large.Outputs`; all of them if not given.
    every : int
        Every so many samples.
    dtype : float64 or float32
        How numbers are stored.
    """

    variables: list[str] | None = None
    every: int = 1
    dtype: Literal["float64", "float32"] = "float64"


class FleetTable(StrictTable):
    """The whole fleet file.

    Parameters
    ----------
    title : str
        Heading.
    problem : str
        Problem file of one recording.
    recordings : table
        Which ones.
    sweep : dict
        Key of the problem file to the values that it takes, a list or a range.
    keep : table
        Results that are written; none if not given.
    """

    title: str = ""
    problem: str
    recordings: RecordingsTable
    sweep: dict[str, Any] = pydantic.Field(default_factory=dict)
    keep: KeepTable | None = None


class RangeTable(StrictTable):
    """Values of a key of ``[sweep]``: from, to, and how many or how far apart.

    Parameters
    ----------
    start, to : float
        Ends, written ``from`` and ``to``.
    step : float
        Distance of neighbours.
    count : int
        Number of values.
    scale : linear or log
        How values are spaced if their number is given.
    """

    start: int | float = pydantic.Field(alias="from")
    to: int | float
    step: int | float | None = pydantic.Field(default=None, gt=0)
    count: int | None = pydantic.Field(default=None, ge=1)
    scale: Literal["linear", "log"] = "linear"
