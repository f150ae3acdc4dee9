"""Recordings that are made of others."""

from backsight.data.derived.converting import convert_units as convert_units
