"""Source code in C99."""

from backsight.engine.c99.leaf import Precision as Precision
from backsight.engine.c99.source import SettingsField as SettingsField
