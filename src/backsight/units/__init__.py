"""Units as engineers write them, and the way from one to another."""

from backsight.units.spelling import PATTERN as PATTERN
from backsight.units.spelling import Conversion as Conversion
from backsight.units.spelling import UnitError as UnitError
from backsight.units.spelling import base_units as base_units
from backsight.units.spelling import check_unit as check_unit
from backsight.units.spelling import conversion as conversion
from backsight.units.spelling import convertible as convertible
from backsight.units.spelling import is_unit as is_unit
