"""The arrival costs as the window of the compressive-sensing estimator knows them."""

from collections.abc import Iterator
from typing import TypeAlias

import casadi as ca

from backsight.estimators.arrival import ConstantArrival, NoArrival, SmoothedArrival
from backsight.estimators.scaled import Setting

LinearArrival: TypeAlias = SmoothedArrival | ConstantArrival | NoArrival
"""Those that the window has; a Kalman filter of its own, of a linear model, is the smoothed one."""

NONE, CONSTANT, FILTERED, SMOOTHED = range(4)
"""Arrival costs as the kernel counts them."""


def counted(arrival: LinearArrival) -> int:
    """Number of an arrival cost in the kernel.

    The model is linear: to linearise along the trajectory that the whole window sees is to take
    its forces, and what is left of `SmoothedArrival` is a Kalman filter that knows them.
    """
    match arrival:
        case NoArrival():
            return NONE
        case ConstantArrival():
            return CONSTANT
        case SmoothedArrival(naive=True):
            return SMOOTHED
        case SmoothedArrival():
            return FILTERED


def next_covariance(arrival: LinearArrival, s: Setting, found: ca.MX) -> ca.MX:
    """Of the second state of a window, which the next one begins with, (nx, nx)."""
    return ca.MX(arrival.scaled(s)) if isinstance(arrival, ConstantArrival) else found


def arrival_faults(arrival: LinearArrival) -> Iterator[str]:
    """Say what the window cannot take of an arrival cost."""
    if isinstance(arrival, NoArrival) and arrival.width != NoArrival().width:
        yield (
            f"the arrival cost is {arrival}; its width is that of a proximal point, which this "
            "estimator does not need: the first state is free. Take NoArrival()"
        )
