"""Compressive-sensing moving horizon estimation: sparse unknown forces."""

from backsight.estimators.cs_mhe.carryover import Carryover as Carryover
from backsight.estimators.cs_mhe.estimator import CompressiveSensingMHE as CompressiveSensingMHE
