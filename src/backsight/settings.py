"""Parts of estimators: limits, arrival costs, rules for outliers, solvers, gains."""

from backsight.estimators import ConstantArrival as ConstantArrival
from backsight.estimators import EKFArrival as EKFArrival
from backsight.estimators import Limit as Limit
from backsight.estimators import NoArrival as NoArrival
from backsight.estimators import SmoothedArrival as SmoothedArrival
from backsight.estimators import UKFArrival as UKFArrival
from backsight.estimators.observers import AdaptiveGain as AdaptiveGain
from backsight.estimators.outliers import Gate as Gate
from backsight.estimators.outliers import Huber as Huber
from backsight.estimators.outliers import StudentT as StudentT
from backsight.solvers.box import GaussNewton as GaussNewton
from backsight.solvers.box import QuasiNewton as QuasiNewton
