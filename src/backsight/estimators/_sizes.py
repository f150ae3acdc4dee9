"""The size of every signal, by which an estimator divides it."""

import dataclasses

from backsight.errors import TuningError
from backsight.models.signals import Signal
from backsight.types import Array

WALK_SAMPLES = 100
"""Samples of random walk that count for the size of a state without a scale."""

SMALLEST, LARGEST = 1e-151, 1e151
"""Sizes whose squares are numbers: covariances are divided by them."""


def with_scales(group: tuple[Signal, ...], typical: Array) -> tuple[Signal, ...]:
    """Signals with a scale, their own or what is typical of them; none if that is zero.

    Raises
    ------
    TuningError
        If the square of a scale would be no number of the computer.
    """
    sized = tuple(
        s if s.scale is not None or t == 0 else dataclasses.replace(s, scale=float(t))
        for s, t in zip(group, typical, strict=True)
    )
    for signal in sized:
        if signal.scale is not None and not SMALLEST < signal.scale < LARGEST:
            raise TuningError(
                f"'{signal.name}' is of the size {signal.scale:g} by its value, prior, noise and "
                f"scale; sizes from {SMALLEST:g} to {LARGEST:g} can be squared: choose another unit"
            )
    return sized
