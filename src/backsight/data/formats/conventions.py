"""What the attributes of an array say of its numbers, by the conventions of NetCDF.

Source: NetCDF Climate and Forecast (CF) Metadata Conventions 1.11, sections 3.1 (units), 4.4 (time)
and 8.1 (packed data), https://cfconventions.org.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from backsight.errors import DataError
from backsight.types import Array

PACKED = ("scale_factor", "add_offset", "_FillValue", "missing_value")
"""Attributes of numbers that are stored as others; xarray undoes that of NetCDF by itself."""


def unit_in(attributes: Mapping[str, Any]) -> str:
    """Unit that attributes say, "" if they say none."""
    found = next((attributes[key] for key in ("units", "unit", "Units") if key in attributes), "")
    found = found.decode(errors="replace") if isinstance(found, bytes) else found
    return found.strip() if isinstance(found, str) else ""


def counts_from_date(attributes: Mapping[str, Any]) -> bool:
    """Whether numbers count from a date on: ``ms since 2026-03-01``."""
    return " since " in unit_in(attributes)


def dates(values: Array, attributes: Mapping[str, Any], name: str) -> np.ndarray:
    """Dates of numbers that count from one on, (n,) of ``datetime64[ns]``.

    Raises
    ------
    DataError
        If the unit or the calendar is none that is known.
    """
    unit = unit_in(attributes)
    kept = {"units": unit, "calendar": attributes.get("calendar", "standard")}
    table = xr.Dataset({"time": ("n", np.ravel(values), kept)})
    try:
        decoded = xr.decode_cf(table)["time"].to_numpy()
    except (ValueError, OverflowError, ImportError) as error:
        reason = str(error).partition("\n")[0]
        raise DataError(f"'{name}' counts '{unit}', which cannot be read: {reason}") from None
    if decoded.dtype.kind != "M":
        raise DataError(f"'{name}' counts by the calendar '{kept['calendar']}', which has no dates")
    return decoded


def physical_values(values: Array, attributes: Mapping[str, Any]) -> Array:
    """Numbers that were stored as others, with a factor, an offset and one for "not measured"."""
    told = {key: np.ravel(attributes[key]) for key in PACKED if key in attributes}
    told = {key: value[0] for key, value in told.items() if value.dtype.kind in "fiu"}
    for key in ("_FillValue", "missing_value"):
        if key in told and (values == told[key]).any():
            values = np.where(values == told[key], np.nan, values)
    factor, offset = float(told.get("scale_factor", 1.0)), float(told.get("add_offset", 0.0))
    return values if (factor, offset) == (1.0, 0.0) else factor * values + offset
