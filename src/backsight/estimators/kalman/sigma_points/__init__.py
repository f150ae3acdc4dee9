"""Sigma points of the unscented Kalman filter: where they are, and what smoothers see of them."""

from backsight.estimators.kalman.sigma_points._images import images_ahead as images_ahead
from backsight.estimators.kalman.sigma_points._images import images_seen as images_seen
from backsight.estimators.kalman.sigma_points._looks import unscented_looks as unscented_looks
from backsight.estimators.kalman.sigma_points._pairs import Outside as Outside
from backsight.estimators.kalman.sigma_points._pairs import SigmaPoints as SigmaPoints
from backsight.estimators.kalman.sigma_points._pairs import points_of as points_of
