"""The columns of a file: what was found out about them."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from backsight.data.listing._period import ToldPeriod
from backsight.data.listing._text import table_of
from backsight.description import Printed


@dataclasses.dataclass(frozen=True)
class FileColumn(Printed):
    """A column of a file.

    Parameters
    ----------
    name : str
        As `backsight.read` takes it.
    kind : {"numbers", "dates", "other"}
        Numbers can be signals.
    unit : str
        As the file says it, "" if it does not.
    samples : int
        Rows, whether measured or not.
    rate : float
        Samples per second; NaN if the file does not tell.
    low, high : float
        Of the measured samples.
    missing : int
        Samples that are not measured.
    noise : float
        Standard deviation of what changes from sample to sample without any trend [`unit`]: of a
        signal that is smooth over four samples the noise.
    walk : float
        Standard deviation of the change of its slope from sample to sample [`unit`], beside noise.
    remarks : tuple of str
        What looks wrong: codes for "not measured", clipping, dropouts; or what it is instead.
    """

    name: str
    kind: Literal["numbers", "dates", "other"]
    unit: str = ""
    samples: int = 0
    rate: float = np.nan
    low: float = np.nan
    high: float = np.nan
    missing: int = 0
    noise: float = np.nan
    walk: float = np.nan
    remarks: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class FileColumns(Mapping[str, FileColumn]):
    """The columns of a file by name; prints itself as a table.

    Parameters
    ----------
    path : Path
    columns : dict
        Name to column.
    clock : str or None
        Column that seems to be time; "" if the file has a time of its own; None without either.
    sure : bool
        Whether the clock is one by its name, or only by its numbers.
    factor : float
        From the numbers of the clock to seconds.
    time_format : str
        Of the clock, as `backsight.read` takes it; "" if it needs none.
    begin : str
        Date of the first sample, if it is known.
    dt : float
        Mean sampling period, without gaps, or what the file tells [s]; NaN if it is not known.
    even : bool
        Whether the samples are evenly spaced.
    codes : tuple of float
        Values that seem to mean "not measured".
    understood : str
        How the file was understood, where it could be seen otherwise.
    remarks : tuple of str
        On the clock.
    told : ToldPeriod or None
        A number of the file that seems to be its sampling period or rate, where there is no clock.
    """

    path: Path
    columns: Mapping[str, FileColumn]
    clock: str | None
    sure: bool
    factor: float
    time_format: str
    begin: str
    dt: float
    even: bool
    codes: tuple[float, ...]
    understood: str
    remarks: tuple[str, ...]
    told: ToldPeriod | None = None

    def __getitem__(self, name: str) -> FileColumn:
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def timed(self) -> bool:
        """Whether time or sampling period are known, by their names."""
        return self.told is not None or (self.clock is not None and self.sure)

    @property
    def signals(self) -> tuple[FileColumn, ...]:
        """Columns that can be inputs or outputs: numbers, without the clock."""
        found = [
            c for c in self.columns.values() if c.kind == "numbers" and not self._is_clock(c.name)
        ]
        return tuple(found)

    def _is_clock(self, name: str) -> bool:
        return self.sure and name == self.clock

    def table(self, width: int = 80) -> str:
        """Return what was found as text of so many columns at most, names permitting."""
        return table_of(self, width)

    def __str__(self) -> str:
        return self.table()
