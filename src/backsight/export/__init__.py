"""Code for a controller."""

from backsight.export.c import export_c as export_c
