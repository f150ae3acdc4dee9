"""Comparison of time series whose components have very different sizes."""

import numpy as np


def assert_close(value: np.ndarray, reference: np.ndarray, tolerance: float) -> None:
    """Agreement relative to the largest value of each component; time is the first axis."""
    value, reference = np.asarray(value), np.asarray(reference)
    assert value.shape == reference.shape
    assert np.all(np.isfinite(value)), "a value is not finite"
    size = np.abs(reference).max(axis=0)
    error = np.abs(value - reference).max(axis=0)
    assert np.all(error <= tolerance * size), f"relative error {np.max(error / size):.2e}"
