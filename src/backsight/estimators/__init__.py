"""The estimators: one file per method, listed in `ESTIMATORS`."""

from backsight.estimators.ahg import AHG as AHG
from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.ekf import EKF as EKF
from backsight.estimators.hgo import HGO as HGO
from backsight.estimators.kf import KalmanFilter as KalmanFilter
from backsight.estimators.limits import Limit as Limit
from backsight.estimators.linear_mhe import LinearMHE as LinearMHE
from backsight.estimators.luenberger import Luenberger as Luenberger
from backsight.estimators.mho import MHO as MHO
from backsight.estimators.recursive_mhe import RecursiveMHE as RecursiveMHE
from backsight.estimators.ukf import UKF as UKF
from backsight.estimators.uncertainty import Noise as Noise
from backsight.estimators.uncertainty import Prior as Prior

ESTIMATORS: dict[str, type[AbstractEstimator]] = {
    e.key: e for e in (EKF, UKF, MHO, HGO, AHG, KalmanFilter, LinearMHE, RecursiveMHE, Luenberger)
}
"""Every estimator by its key: the one place where a new one is registered."""
