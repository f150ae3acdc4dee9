"""A setting that is an input of the model, so that it can be tried without compiling."""

from typing import Any, Self


class VariedNumber(float):
    """A number that a description takes as it takes any other, and that an input of the model is.

    As a float it is where it starts. `backsight.tune.fit` makes it and keeps the input constant
    over a recording; it is no part of what a user describes. Methods whose `varied_settings` name
    the field read it by `varied_at`.

    Parameters
    ----------
    value : float
    index : int
        Place among the inputs, whose scale must be one.
    """

    index: int

    def __new__(cls, value: float, index: int) -> Self:
        """Keep the place with the number."""
        made = super().__new__(cls, value)
        made.index = index
        return made

    def __getnewargs__(self) -> tuple[float, int]:  # type: ignore[override]
        return float(self), self.index


def varied_at(given: float, u: Any) -> Any:
    """Value of a setting at inputs u, SX or MX: itself, or the input that it is."""
    return u[given.index] if isinstance(given, VariedNumber) else given
