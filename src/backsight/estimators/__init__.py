"""The estimators: one file per method, listed in `ESTIMATORS`."""

from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.cs_mhe import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators.joint_input import JointInput as JointInput
from backsight.estimators.kalman import EKF as EKF
from backsight.estimators.kalman import UKF as UKF
from backsight.estimators.kalman import KalmanFilter as KalmanFilter
from backsight.estimators.kalman import Luenberger as Luenberger
from backsight.estimators.linear_windows import LinearMHE as LinearMHE
from backsight.estimators.linear_windows import RecursiveMHE as RecursiveMHE
from backsight.estimators.mhe import MHE as MHE
from backsight.estimators.mhe import ConstantArrival as ConstantArrival
from backsight.estimators.mhe import EKFArrival as EKFArrival
from backsight.estimators.mhe import NoArrival as NoArrival
from backsight.estimators.mhe import SmoothedArrival as SmoothedArrival
from backsight.estimators.mhe import UKFArrival as UKFArrival
from backsight.estimators.mho import MHO as MHO
from backsight.estimators.observers import AHG as AHG
from backsight.estimators.observers import HGO as HGO
from backsight.estimators.parts.limits import Limit as Limit
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
