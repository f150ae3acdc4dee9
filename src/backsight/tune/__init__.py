"""Settings of estimators from a nominal model and a motion."""

from backsight.tune.high_gain import propose_gamma as propose_gamma
from backsight.tune.high_gain import propose_lambda as propose_lambda
from backsight.tune.threshold import propose_threshold as propose_threshold
