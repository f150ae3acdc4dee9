"""Ways to run an estimator with other values: all at once in lanes, or built anew for each."""

from backsight.tune.fitting.runners._delays import delays_of as delays_of
from backsight.tune.fitting.runners._lanes import Data as Data
from backsight.tune.fitting.runners._lanes import LaneRunner as LaneRunner
from backsight.tune.fitting.runners._lanes import able_settings as able_settings
from backsight.tune.fitting.runners._lanes import lanes_of as lanes_of
from backsight.tune.fitting.runners._rebuilt import Rebuilt as Rebuilt
from backsight.tune.fitting.runners._wide import opened_to_inputs as opened_to_inputs
