"""Limits imposed on the result of a linear window."""

from backsight.solvers.limits.inequalities import limited as limited
