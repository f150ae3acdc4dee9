"""Moving horizon observer."""

from backsight.estimators.mho._cost import window_cost as window_cost
from backsight.estimators.mho.estimator import MHO as MHO
