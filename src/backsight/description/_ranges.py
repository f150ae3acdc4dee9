"""What stands beside a type in `Annotated`: the range of a number, and how a message calls it."""

import dataclasses
import math
from typing import Annotated, Literal, TypeAlias


@dataclasses.dataclass(frozen=True)
class Range:
    """Numbers that are allowed; without one, a number must be finite.

    Parameters
    ----------
    must : str
        Of a number that is not in the range, after "it must": ``be positive``.
    lower, upper : float
        Ends of the range. Infinity itself is allowed only if `infinite`.
    above : bool
        `lower` itself is not allowed.
    infinite : bool
        Infinity is allowed where it lies between the ends.
    missing : bool
        NaN is allowed.
    """

    must: str
    lower: float = -math.inf
    upper: float = math.inf
    above: bool = False
    infinite: bool = False
    missing: bool = False

    def __contains__(self, value: float) -> bool:
        if math.isnan(value):
            return self.missing
        if math.isinf(value) and not self.infinite:
            return False
        return (self.lower < value if self.above else self.lower <= value) and value <= self.upper

    @property
    def whole(self) -> str:
        """What the number must be, finite as well where the ends alone do not say so."""
        if self.infinite or math.isinf(self.lower) or not math.isinf(self.upper):
            return self.must
        return f"{self.must} and {'be ' if self.must.startswith('not') else ''}finite"

    def wanted(self, value: float) -> str:
        """What a number outside of the range must be, after "it must"."""
        return self.must if math.isfinite(value) else self.whole


@dataclasses.dataclass(frozen=True)
class Called:
    """What a message calls the value; the name of the field if not given.

    Parameters
    ----------
    name : str
    unit : str
        Shown behind a number.
    """

    name: str
    unit: str = ""


@dataclasses.dataclass(frozen=True)
class Distinct:
    """No entry of a tuple may occur twice."""


FINITE = Range("be finite")

Positive: TypeAlias = Annotated[float, Range("be positive", 0.0, above=True)]
PositiveOrInfinite: TypeAlias = Annotated[
    float, Range("be positive", 0.0, above=True, infinite=True)
]
NonNegative: TypeAlias = Annotated[float, Range("not be negative", 0.0)]
Share: TypeAlias = Annotated[float, Range("be from 0 to 1", 0.0, 1.0)]
Level: TypeAlias = Annotated[float, Range("be between 0 and 1", math.ulp(0.0), 1 - math.ulp(0.5))]
"""A probability that is neither 0 nor 1."""

Unlimited: TypeAlias = Annotated[float, Range("be a number", infinite=True)]
"""A bound, which infinity leaves out."""

Count: TypeAlias = Annotated[int, Range("be a whole number from 1 on", 1)]
Whole: TypeAlias = Annotated[int, Range("be a whole number from 0 on", 0)]
Horizon: TypeAlias = Annotated[
    int, Range("be a whole number from 1 on", 1), Called("the horizon N")
]
"""Sampling periods that a window spans."""

Lag: TypeAlias = Annotated[Whole | Literal["N"], Called("the lag")]
"""Samples from the newest one back to that of the estimate; "N" is all of the window."""
