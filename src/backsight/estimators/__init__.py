"""The estimators: one file per method, listed in `ESTIMATORS`."""

from backsight.estimators.base import AbstractEstimator as AbstractEstimator
from backsight.estimators.ekf import EKF as EKF
from backsight.estimators.mho import MHO as MHO
from backsight.estimators.uncertainty import Noise as Noise
from backsight.estimators.uncertainty import Prior as Prior

ESTIMATORS: dict[str, type[AbstractEstimator]] = {e.key: e for e in (EKF, MHO)}
"""Every estimator by its key: the one place where a new one is registered."""
