"""Kalman filters and the observer with a constant gain."""

from backsight.estimators.kalman.ekf import EKF as EKF
from backsight.estimators.kalman.iekf import IEKF as IEKF
from backsight.estimators.kalman.kf import KalmanFilter as KalmanFilter
from backsight.estimators.kalman.luenberger import Luenberger as Luenberger
from backsight.estimators.kalman.ukf import UKF as UKF
