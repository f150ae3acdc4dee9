"""Tuning of estimators by their own predictions: no truth is needed."""

from backsight.tune.fitting._fit import fit as fit
from backsight.tune.fitting.criteria import AbstractCriterion as AbstractCriterion
from backsight.tune.fitting.criteria import Likelihood as Likelihood
from backsight.tune.fitting.criteria import MultiStep as MultiStep
from backsight.tune.fitting.criteria import Prediction as Prediction
from backsight.tune.fitting.criteria import Simulation as Simulation
from backsight.tune.fitting.criteria import Whiteness as Whiteness
from backsight.tune.fitting.tuned import HeldOut as HeldOut
from backsight.tune.fitting.tuned import Tuned as Tuned
from backsight.tune.fitting.values import Choice as Choice
from backsight.tune.fitting.values import Free as Free
