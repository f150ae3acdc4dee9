"""Moving horizon estimation of nonlinear models, with process noise and limits."""

from backsight.estimators.mhe.arrival import AbstractArrival as AbstractArrival
from backsight.estimators.mhe.arrival import ConstantArrival as ConstantArrival
from backsight.estimators.mhe.arrival import EKFArrival as EKFArrival
from backsight.estimators.mhe.arrival import NoArrival as NoArrival
from backsight.estimators.mhe.arrival import SmoothedArrival as SmoothedArrival
from backsight.estimators.mhe.arrival import UKFArrival as UKFArrival
from backsight.estimators.mhe.estimator import MHE as MHE
