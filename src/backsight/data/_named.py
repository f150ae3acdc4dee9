"""Signals out of what holds them by name: data frames, datasets, dictionaries, records."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from backsight.data.formats.conventions import counts_from_date, dates, unit_in
from backsight.errors import DataError, nearest
from backsight.units import conversion, convertible


def is_named(values: Any) -> bool:
    """Whether columns have names of their own, so that their order does not count."""
    if isinstance(values, Mapping | pd.DataFrame | xr.Dataset):
        return True
    if isinstance(values, xr.DataArray):
        return values.ndim == 2
    if isinstance(values, np.ndarray):
        return values.dtype.names is not None
    # polars, pyarrow, and others that are not needed here; a lazy frame must not be asked itself
    return hasattr(type(values), "columns") and hasattr(values, "__getitem__")


def named_columns(values: Any, wanted: Iterable[str], what: str, where: str) -> dict[str, Any]:
    """The wanted columns by name, in the order of `wanted`; others are left.

    Raises
    ------
    DataError
        If names are missing.
    """
    columns = _columns(values, list(wanted), what, where)
    absent = [name for name in wanted if name not in columns]
    if absent:
        known = [str(name) for name in columns]
        raise DataError(
            f"{where}: {what} has no column '{absent[0]}': {nearest(absent[0], known)}; columns "
            "that have names go in by name (rename them, or give the numbers alone, in order)"
        )
    return {name: columns[name] for name in wanted}


def unit_of(values: Any, name: str) -> str:
    """Unit that a dataset, a labelled array or a quantity says of a column, "" if it says none."""
    if isinstance(values, xr.Dataset):
        return unit_in(values[name].attrs) if name in values.variables else ""
    if isinstance(values, xr.DataArray):
        return unit_in(values.attrs)
    return f"{values.units:~}" if is_quantity(values) else ""


def is_quantity(values: Any) -> bool:
    """Whether this is an array with a unit, of pint."""
    return hasattr(type(values), "magnitude") and hasattr(type(values), "units")


def index_of(values: Any) -> Any:
    """Times that a data frame or dataset brings along as its index, None if it has none."""
    index = getattr(values, "index", None)
    if isinstance(values, pd.DataFrame | pd.Series):
        timely = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex)
        return index if timely or (index is not None and index.name == "time") else None
    if isinstance(values, xr.Dataset | xr.DataArray) and "time" in values.coords:
        return _timed(values["time"])
    return None


def _timed(time: xr.DataArray) -> np.ndarray:
    """Dates, or numbers in seconds."""
    values, unit = time.to_numpy(), unit_in(time.attrs)
    if values.dtype.kind not in "fiu" or not unit:
        return values
    return (
        dates(values, time.attrs, "time")
        if counts_from_date(time.attrs)
        else in_seconds(values, unit)
    )


def in_seconds(values: np.ndarray, unit: str) -> np.ndarray:
    """Times in seconds by a unit; those of no known unit stay as they are."""
    return conversion(unit, "s").applied(values) if convertible(unit, "s") else values


def _columns(values: Any, wanted: list[str], what: str, where: str) -> Mapping[Any, Any]:
    if isinstance(values, xr.DataArray):
        return _labelled(values, wanted, what, where)
    if isinstance(values, xr.Dataset):
        return {name: values[name].to_numpy() for name in values.variables}
    if isinstance(values, Mapping):
        return values
    if isinstance(values, np.ndarray):
        return {name: values[name] for name in values.dtype.names or ()}
    values = values.collect() if hasattr(values, "collect") else values  # a lazy frame
    names = getattr(values, "column_names", None) or list(values.columns)
    double = [name for name in wanted if list(names).count(name) > 1]
    if double:
        raise DataError(f"{where}: {what} has several columns '{double[0]}'; rename them")
    return {name: values[name] for name in names}


def _labelled(values: xr.DataArray, wanted: list[str], what: str, where: str) -> dict[str, Any]:
    """Columns of a matrix with labels along one of its dimensions."""
    for dim in values.dims:
        labels = values.coords[dim].to_numpy().tolist() if dim in values.coords else []
        if labels and all(isinstance(label, str) for label in labels):
            return {name: values.isel({dim: k}).to_numpy() for k, name in enumerate(labels)}
    raise DataError(
        f"{where}: no dimension of {what} has the names {', '.join(wanted)} as labels; give the "
        "numbers alone (.to_numpy()), time first"
    )
