"""Dictionaries: of which atoms an unknown force is made."""

from typing import TypeAlias

from backsight.estimators.dictionaries.atoms import Atoms as Atoms
from backsight.estimators.dictionaries.moving_loads import ForceLine as ForceLine
from backsight.estimators.dictionaries.moving_loads import MovingLoads as MovingLoads
from backsight.estimators.dictionaries.pulses import AbstractPulses as AbstractPulses
from backsight.estimators.dictionaries.pulses import Decays as Decays
from backsight.estimators.dictionaries.pulses import HalfSines as HalfSines
from backsight.estimators.dictionaries.pulses import Haversines as Haversines
from backsight.estimators.dictionaries.pulses import Impulses as Impulses
from backsight.estimators.dictionaries.pulses import Splines as Splines
from backsight.estimators.dictionaries.pulses import SteadyLoads as SteadyLoads

Dictionary: TypeAlias = (
    Impulses | HalfSines | Haversines | Splines | Decays | SteadyLoads | MovingLoads | Atoms
)
"""Of which atoms a force may be made."""
