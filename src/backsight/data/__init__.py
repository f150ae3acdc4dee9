"""Read, check, align and merge recordings."""

from backsight.data.columns import Column
from backsight.data.derived import convert_units, remove_delays
from backsight.data.finite_elements import (
    Matrix,
    ModeShapes,
    SensorList,
    read_forces,
    read_matrix,
    read_modes,
    read_sensors,
)
from backsight.data.increments import increments
from backsight.data.listing import list_columns
from backsight.data.merging import merge
from backsight.data.reader import read
from backsight.data.recording import from_arrays
from backsight.data.resampling import resample, to_grid

__all__ = [
    "Column",
    "Matrix",
    "ModeShapes",
    "SensorList",
    "convert_units",
    "from_arrays",
    "increments",
    "list_columns",
    "merge",
    "read",
    "read_forces",
    "read_matrix",
    "read_modes",
    "read_sensors",
    "remove_delays",
    "resample",
    "to_grid",
]
