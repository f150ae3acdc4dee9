"""Read, check, align and merge recordings."""

from backsight.data.columns import Column
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
from backsight.data.merging import merge
from backsight.data.reader import read
from backsight.data.recording import from_arrays
from backsight.data.resampling import resample

__all__ = [
    "Column",
    "Matrix",
    "ModeShapes",
    "SensorList",
    "from_arrays",
    "increments",
    "merge",
    "read",
    "read_forces",
    "read_matrix",
    "read_modes",
    "read_sensors",
    "resample",
]
