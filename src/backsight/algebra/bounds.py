"""Bounds on the elements of a vector."""

import casadi as ca
import numpy as np

from backsight.types import Array


def clip(x: ca.SX, lower: Array, upper: Array) -> ca.SX:
    """Set elements outside their bounds to the bounds; infinite bounds cost nothing."""
    bounded = ca.SX(x)
    for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
        if np.isfinite(low):
            bounded[i] = ca.fmax(bounded[i], low)
        if np.isfinite(high):
            bounded[i] = ca.fmin(bounded[i], high)
    return bounded
