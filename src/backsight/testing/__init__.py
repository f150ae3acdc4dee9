"""The contract of estimators, models and readers, for those who write their own.

`check_estimator` is what every estimator of the package has to pass. Needs no test framework.
"""

from backsight.testing._own import CASES as CASES
from backsight.testing.case import ENGINES as ENGINES
from backsight.testing.case import Build as Build
from backsight.testing.case import Case as Case
from backsight.testing.case import Subject as Subject
from backsight.testing.checks import CHECKS as CHECKS
from backsight.testing.checks import Check as Check
from backsight.testing.close import assert_close as assert_close
from backsight.testing.estimators import check_estimator as check_estimator
from backsight.testing.others import check_model as check_model
from backsight.testing.others import check_reader as check_reader
from backsight.testing.problem import DT as DT
from backsight.testing.problem import K_TRUE as K_TRUE
from backsight.testing.problem import WALK as WALK
from backsight.testing.problem import Data as Data
from backsight.testing.problem import R as R
from backsight.testing.problem import TrialProblem as TrialProblem
from backsight.testing.problem import simulated as simulated
