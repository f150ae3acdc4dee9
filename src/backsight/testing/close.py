"""Comparison of time series whose components have very different sizes."""

import numpy as np


class ContractError(AssertionError):
    """A promise of the contract is not kept."""


def require(condition: object, message: str) -> None:
    """Raise `ContractError` with the message unless the condition holds."""
    if not condition:
        raise ContractError(message)


def assert_close(
    value: np.ndarray, reference: np.ndarray, tolerance: float, what: str = "value"
) -> None:
    """Agreement relative to the largest value of each component; time is the first axis."""
    value, reference = np.asarray(value), np.asarray(reference)
    require(
        value.shape == reference.shape,
        f"{what} has the shape {value.shape}, not {reference.shape}",
    )
    require(np.all(np.isfinite(value)), f"{what} is not finite")
    size = np.abs(reference).max(axis=0)
    error = np.abs(value - reference).max(axis=0)
    if np.all(error <= tolerance * size):
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.nanmax(error / size)
    raise ContractError(f"{what} has a relative error of {relative:.2e}, above {tolerance:g}")


def assert_same(value: np.ndarray, reference: np.ndarray, what: str) -> None:
    """Agreement to the last bit; NaN agrees with NaN."""
    value, reference = np.asarray(value), np.asarray(reference)
    require(
        value.shape == reference.shape,
        f"{what} has the shape {value.shape}, not {reference.shape}",
    )
    if not np.array_equal(value, reference, equal_nan=True):
        first = np.argwhere(~((value == reference) | (np.isnan(value) & np.isnan(reference))))[0]
        at = tuple(int(i) for i in first)
        raise ContractError(
            f"{what} differs, first at {at}: {value[at]!r} instead of {reference[at]!r}"
        )
