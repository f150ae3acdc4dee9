"""Moving horizon estimation of nonlinear models, with process noise and limits."""

from backsight.estimators.mhe.estimator import MHE as MHE
