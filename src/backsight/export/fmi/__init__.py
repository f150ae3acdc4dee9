"""Functional mock-up units, FMI 3.0."""

from backsight.export._compiler import Platform as Platform
from backsight.export.fmi.fmu import export_fmu as export_fmu
