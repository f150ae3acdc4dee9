"""Code for a controller."""

from backsight.export.c import export_c as export_c
from backsight.export.fmi import export_fmu as export_fmu
