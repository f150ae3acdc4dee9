"""What makes settings good: criteria of predictions, one to a file."""

from backsight.tune.fitting.criteria._base import AbstractCriterion as AbstractCriterion
from backsight.tune.fitting.criteria._base import Measure as Measure
from backsight.tune.fitting.criteria._base import Piece as Piece
from backsight.tune.fitting.criteria._likelihood import Likelihood as Likelihood
from backsight.tune.fitting.criteria._likelihood import Prediction as Prediction
from backsight.tune.fitting.criteria._likelihood import Simulation as Simulation
from backsight.tune.fitting.criteria._multi_step import MultiStep as MultiStep
from backsight.tune.fitting.criteria._whiteness import Whiteness as Whiteness
