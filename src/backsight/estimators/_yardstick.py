"""The filter that other estimators are held against."""

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.kalman import EKF, KalmanFilter
from backsight.models.lti import bent
from backsight.models.model import Model


def yardstick(estimator: AbstractEstimator, model: Model) -> EKF | KalmanFilter:
    """Return the Kalman filter with the noise and the prior of an estimator.

    The extended one, if the model is not linear in its states, or one of them is positive.

    Raises
    ------
    TuningError
        If the estimator has none.
    """
    noise, prior = estimator.assumed
    hold = estimator.input_hold
    if bent(model) or any(s.positive for s in model.states):
        return EKF(noise, prior, estimator.integration or Integrator(hold=hold))
    return KalmanFilter(noise, prior, hold=hold)
