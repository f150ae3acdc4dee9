"""Gains that stay as they are once the covariance, which no measurement changes, has converged."""

from backsight.estimators.steady.linear_filter import filter_limit as filter_limit
from backsight.estimators.steady.linear_filter import limit_of as limit_of
from backsight.estimators.steady.linear_filter import may_be_worth as may_be_worth
from backsight.estimators.steady.linear_filter import reusing_filter as reusing_filter
from backsight.estimators.steady.reuse import kept_parts as kept_parts
from backsight.estimators.steady.reuse import reused as reused
from backsight.estimators.steady.reuse import waited as waited
from backsight.estimators.steady.state import SteadyState as SteadyState
from backsight.estimators.steady.state import steady_state as steady_state
