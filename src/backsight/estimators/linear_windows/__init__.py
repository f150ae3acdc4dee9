"""Least-squares windows of linear models, whole and recursive."""

from backsight.estimators.linear_windows.linear_mhe import LinearMHE as LinearMHE
from backsight.estimators.linear_windows.recursive_mhe import RecursiveMHE as RecursiveMHE
from backsight.estimators.linear_windows.stacked import gains as gains
from backsight.estimators.linear_windows.stacked import in_units as in_units
from backsight.estimators.linear_windows.stacked import stacked as stacked
