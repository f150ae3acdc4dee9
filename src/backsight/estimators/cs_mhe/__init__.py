"""Compressive-sensing moving horizon estimation: sparse unknown forces."""

from backsight.estimators.cs_mhe.carryover import Carryover as Carryover
from backsight.estimators.cs_mhe.dictionary import Atoms as Atoms
from backsight.estimators.cs_mhe.dictionary import HalfSines as HalfSines
from backsight.estimators.cs_mhe.dictionary import Impulses as Impulses
from backsight.estimators.cs_mhe.estimator import CompressiveSensingMHE as CompressiveSensingMHE
