"""The estimators: one file per method, listed in `ESTIMATORS`."""

from backsight.estimators.ahg import AHG as AHG
from backsight.estimators.arrival import ConstantArrival as ConstantArrival
from backsight.estimators.arrival import EKFArrival as EKFArrival
from backsight.estimators.arrival import NoArrival as NoArrival
from backsight.estimators.arrival import SmoothedArrival as SmoothedArrival
from backsight.estimators.arrival import UKFArrival as UKFArrival
from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.cs_mhe import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators.ekf import EKF as EKF
from backsight.estimators.hgo import HGO as HGO
from backsight.estimators.joint_input import JointInput as JointInput
from backsight.estimators.kf import KalmanFilter as KalmanFilter
from backsight.estimators.limits import Limit as Limit
from backsight.estimators.linear_mhe import LinearMHE as LinearMHE
from backsight.estimators.luenberger import Luenberger as Luenberger
from backsight.estimators.mhe import MHE as MHE
from backsight.estimators.mho import MHO as MHO
from backsight.estimators.recursive_mhe import RecursiveMHE as RecursiveMHE
from backsight.estimators.ukf import UKF as UKF
from backsight.estimators.uncertainty import Noise as Noise
from backsight.estimators.uncertainty import Prior as Prior

ESTIMATORS: dict[str, type[AbstractEstimator]] = {
    e.key: e
    for e in (
        EKF,
        UKF,
        MHO,
        HGO,
        AHG,
        KalmanFilter,
        LinearMHE,
        RecursiveMHE,
        Luenberger,
        JointInput,
        CompressiveSensingMHE,
        MHE,
    )
}
"""Every estimator by its key: the one place where a new one is registered."""
