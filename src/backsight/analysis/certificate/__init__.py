"""Exact references that an estimator can be held against."""

from backsight.analysis.certificate.certificate import Certificate as Certificate
from backsight.analysis.certificate.certificate import Claim as Claim
from backsight.analysis.certificate.linear_gaussian import Estimates as Estimates
from backsight.analysis.certificate.linear_gaussian import LinearGaussian as LinearGaussian
from backsight.analysis.certificate.linear_gaussian import (
    dense_least_squares as dense_least_squares,
)
from backsight.analysis.certificate.linear_gaussian import draw as draw
from backsight.analysis.certificate.linear_gaussian import lagged as lagged
