"""Matrices, mode shapes and tables of places from files of finite-element programs and tests."""

from backsight.data.finite_elements.matrix import EPS as EPS
from backsight.data.finite_elements.matrix import Matrix as Matrix
from backsight.data.finite_elements.modes import ModeShapes as ModeShapes
from backsight.data.finite_elements.modes import read_modes as read_modes
from backsight.data.finite_elements.places import SensorList as SensorList
from backsight.data.finite_elements.places import read_forces as read_forces
from backsight.data.finite_elements.places import read_sensors as read_sensors
from backsight.data.finite_elements.reading import MatrixFormat as MatrixFormat
from backsight.data.finite_elements.reading import read_matrix as read_matrix
