"""Source code in C99."""

from backsight.engine.c99._interface import SettingsField as SettingsField
from backsight.engine.c99.leaf import Precision as Precision
