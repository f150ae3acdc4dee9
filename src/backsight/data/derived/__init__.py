"""Recordings that are made of others."""

from backsight.data.derived.converting import convert_units as convert_units
from backsight.data.derived.delaying import remove_delays as remove_delays
from backsight.data.derived.formulas import columns_in as columns_in
from backsight.data.derived.formulas import evaluated as evaluated
