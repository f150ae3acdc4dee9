"""The estimators: one file per method, listed in `ESTIMATORS`."""

import inspect

from backsight.errors import TuningError
from backsight.estimators._compiling import Compilable as Compilable
from backsight.estimators._yardstick import yardstick as yardstick
from backsight.estimators.arrival import ConstantArrival as ConstantArrival
from backsight.estimators.arrival import EKFArrival as EKFArrival
from backsight.estimators.arrival import NoArrival as NoArrival
from backsight.estimators.arrival import SmoothedArrival as SmoothedArrival
from backsight.estimators.arrival import UKFArrival as UKFArrival
from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.cs_mhe import CompressiveSensingMHE as CompressiveSensingMHE
from backsight.estimators.joint_input import JointInput as JointInput
from backsight.estimators.kalman import EKF as EKF
from backsight.estimators.kalman import IEKF as IEKF
from backsight.estimators.kalman import UKF as UKF
from backsight.estimators.kalman import KalmanFilter as KalmanFilter
from backsight.estimators.kalman import Luenberger as Luenberger
from backsight.estimators.linear_windows import LinearMHE as LinearMHE
from backsight.estimators.linear_windows import RecursiveMHE as RecursiveMHE
from backsight.estimators.mhe import MHE as MHE
from backsight.estimators.mho import MHO as MHO
from backsight.estimators.observers import AHG as AHG
from backsight.estimators.observers import HGO as HGO
from backsight.estimators.parts.limits import Limit as Limit
from backsight.estimators.uncertainty import Noise as Noise
from backsight.estimators.uncertainty import Prior as Prior
from backsight.plugins import Extended

ESTIMATORS: dict[str, type[AbstractEstimator]] = {
    e.key: e
    for e in (
        EKF,
        IEKF,
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


def _adopted(key: str, found: object) -> type[AbstractEstimator]:
    """Check an estimator of somebody else's as far as it can be done without a model."""
    if not (isinstance(found, type) and issubclass(found, AbstractEstimator)):
        raise TuningError(f"{found!r} is not a subclass of AbstractEstimator")
    if inspect.isabstract(found):
        raise TuningError(f"{found.__name__} has no method 'build'")
    if getattr(found, "key", None) != key:
        raise TuningError(f"{found.__name__}.key must be '{key}', the name of its entry point")
    if not isinstance(getattr(found, "title", None), str):
        raise TuningError(f"{found.__name__}.title must be the name of the method")
    return found


ALL_ESTIMATORS = Extended("backsight.estimators", "estimator", ESTIMATORS, _adopted)
"""Ours and those of installed extensions, which a problem file may use."""
