"""The column of time of a file: what its marks count, by all that is said and seen."""

import dataclasses
from typing import NamedTuple

import numpy as np

from backsight.data.columns import Column
from backsight.data.times.clock import epoch_form, maybe_days, seconds
from backsight.data.times.names import unit_of_clock
from backsight.errors import DataError
from backsight.types import Array


class Times(NamedTuple):
    """Times of the samples.

    Parameters
    ----------
    seconds : (n,) array
        [s].
    begin : str
        Date of their zero, "" if there is none.
    note : str
        How the marks were understood, where it could be seen otherwise.
    """

    seconds: Array
    begin: str
    note: str


def times_of(
    clock: Column, marks: np.ndarray, own: str, *, time_format: str | None, where: str
) -> Times:
    """Read the marks of a clock.

    Parameters
    ----------
    clock : Column
        What is said of it.
    marks : (n,) array
        As they are in the file.
    own : str
        Unit that the file says.
    time_format : str, optional
        As for `backsight.data.times.clock.seconds`.
    where : str
        What messages begin with.

    Raises
    ------
    DataError
        If the marks are no times, or may be days as well as seconds.
    """
    said = clock.factor is not None or bool(clock.unit)
    named = "" if said or own else unit_of_clock(clock.name)
    own = own or named
    form = time_format
    if form is None and not said:
        form = _form(clock.name, marks, own, where)
    given, begin = seconds(marks, time_format=form, where=where)
    if form is None and marks.dtype.kind in "fiub":
        given = _in_seconds(clock, own).physical(given)
    else:
        given = clock.physical(given)
    if form != time_format:
        return Times(given, begin, f"time_format '{form}'")
    return Times(given, begin, f"'{clock.name}' counts {named}" if named not in ("", "s") else "")


def _form(name: str, marks: np.ndarray, own: str, where: str) -> str | None:
    form = epoch_form(marks)
    if own:  # whole numbers of ticks since 1970 stay exact only as such
        return form if form == f"unix_{own}" else None
    if form is not None or marks.dtype.kind != "f" or (days := maybe_days(marks)) is None:
        return form
    step = abs(float(marks[-1] - marks[0])) / (len(marks) - 1)
    raise DataError(
        f"{where}: '{name}' begins at {marks[0]:.9g} and rises by {step:.3g}, which may be day "
        f'numbers or seconds; say time_format = "{days}", or of seconds '
        f'time = {{ name = "{name}", unit = "s" }}'
    )


def _in_seconds(clock: Column, found: str) -> Column:
    """The clock with a factor to seconds by the unit that is given, or that of the file."""
    if clock.factor is not None or clock.unit in ("", "s"):
        return dataclasses.replace(clock, unit="s").settled(found)
    return dataclasses.replace(clock, unit="s").settled(clock.unit)
