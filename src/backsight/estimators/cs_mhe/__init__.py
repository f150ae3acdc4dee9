"""Compressive-sensing moving horizon estimation: sparse unknown forces."""

from backsight.estimators.cs_mhe.carryover import Carryover as Carryover
from backsight.estimators.cs_mhe.estimator import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators.cs_mhe.refinement import Exchanges as Exchanges
from backsight.estimators.cs_mhe.refinement import Reweighting as Reweighting
