"""Least squares with bounds on the unknowns."""

from backsight.solvers.box.bfgs import QuasiNewton as QuasiNewton
from backsight.solvers.box.gauss_newton import GaussNewton as GaussNewton
