"""Settings of estimators from a nominal model and a motion."""

from backsight.tune._force_path import force_path as force_path
from backsight.tune._recovery import Hits as Hits
from backsight.tune._recovery import recovery as recovery
from backsight.tune.calibration import calibrate as calibrate
from backsight.tune.high_gain import propose_gamma as propose_gamma
from backsight.tune.high_gain import propose_lambda as propose_lambda
from backsight.tune.lambda_choice import lambda_from_noise as lambda_from_noise
from backsight.tune.lambda_choice import lambda_from_sensors as lambda_from_sensors
from backsight.tune.lambda_choice import lambda_from_whiteness as lambda_from_whiteness
from backsight.tune.placement import place_sensors as place_sensors
from backsight.tune.sparsity import lambda_max as lambda_max
from backsight.tune.threshold import propose_threshold as propose_threshold
