"""Settings of estimators from a nominal model and a motion."""

from backsight.tune._force_path import trace_force_path as trace_force_path
from backsight.tune._recovery import Hits as Hits
from backsight.tune._recovery import rate_sensors as rate_sensors
from backsight.tune.calibration import calibrate as calibrate
from backsight.tune.fitting import AbstractCriterion as AbstractCriterion
from backsight.tune.fitting import Choice as Choice
from backsight.tune.fitting import Free as Free
from backsight.tune.fitting import HeldOut as HeldOut
from backsight.tune.fitting import Likelihood as Likelihood
from backsight.tune.fitting import MultiStep as MultiStep
from backsight.tune.fitting import Prediction as Prediction
from backsight.tune.fitting import Simulation as Simulation
from backsight.tune.fitting import Tuned as Tuned
from backsight.tune.fitting import Whiteness as Whiteness
from backsight.tune.fitting import fit as fit
from backsight.tune.force_threshold import ThresholdChoice as ThresholdChoice
from backsight.tune.force_threshold import threshold_from_noise as threshold_from_noise
from backsight.tune.high_gain import propose_gain as propose_gain
from backsight.tune.high_gain import propose_gamma as propose_gamma
from backsight.tune.lambda_choice import lambda_from_noise as lambda_from_noise
from backsight.tune.lambda_choice import lambda_from_sensors as lambda_from_sensors
from backsight.tune.lambda_choice import lambda_from_whiteness as lambda_from_whiteness
from backsight.tune.lambda_pairs import lambda_from_pairs as lambda_from_pairs
from backsight.tune.placement import place_sensors as place_sensors
from backsight.tune.sparsity import lambda_max as lambda_max
from backsight.tune.threshold import propose_threshold as propose_threshold
