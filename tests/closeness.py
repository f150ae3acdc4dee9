"""Comparison of time series whose components have very different sizes."""

from backsight.testing import assert_close as assert_close
