"""Compressive-sensing moving horizon estimation: sparse unknown forces."""

from backsight.estimators.cs_mhe.carryover import Carryover as Carryover
from backsight.estimators.cs_mhe.dictionary import Atoms as Atoms
from backsight.estimators.cs_mhe.estimator import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators.cs_mhe.moving_loads import Line as Line
from backsight.estimators.cs_mhe.moving_loads import MovingLoads as MovingLoads
from backsight.estimators.cs_mhe.pulses import AbstractPulses as AbstractPulses
from backsight.estimators.cs_mhe.pulses import Decays as Decays
from backsight.estimators.cs_mhe.pulses import HalfSines as HalfSines
from backsight.estimators.cs_mhe.pulses import Haversines as Haversines
from backsight.estimators.cs_mhe.pulses import Impulses as Impulses
from backsight.estimators.cs_mhe.pulses import Splines as Splines
from backsight.estimators.cs_mhe.pulses import Steps as Steps
