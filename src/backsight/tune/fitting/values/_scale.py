"""On which scale a value is searched: its logarithm, itself, or its place between two bounds."""

import abc
import dataclasses
import math

NEXT = 0.03
"""Share of the way to a bound that is left where a value counts as being there: the prior keeps it
from going all the way."""


@dataclasses.dataclass(frozen=True)
class AbstractScale(abc.ABC):
    """Place t of a value on a scale, 0 at the start; the prior of t is normal with mean 0."""

    start: float

    @abc.abstractmethod
    def value(self, t: float) -> float:
        """Value at a place."""

    @abc.abstractmethod
    def slope(self, t: float) -> float:
        """Derivative of the value by the place."""

    @abc.abstractmethod
    def at_bound(self, t: float) -> bool:
        """Whether the value is next to a bound."""


@dataclasses.dataclass(frozen=True)
class LogScale(AbstractScale):
    """``value = end + (start - end) exp(t)``: never beyond `end`, 0 for standard deviations."""

    end: float = 0.0

    def value(self, t: float) -> float:
        """See `AbstractScale`."""
        return self.end + (self.start - self.end) * math.exp(min(t, 300.0))

    def slope(self, t: float) -> float:
        """See `AbstractScale`."""
        return self.value(t) - self.end

    def at_bound(self, t: float) -> bool:
        """See `AbstractScale`; of 0 nothing is known beyond how flat the likelihood is."""
        return self.end != 0.0 and math.exp(min(t, 300.0)) < NEXT


@dataclasses.dataclass(frozen=True)
class LinearScale(AbstractScale):
    """``value = start + unit t``."""

    unit: float = 1.0

    def value(self, t: float) -> float:
        """See `AbstractScale`."""
        return self.start + self.unit * t

    def slope(self, t: float) -> float:
        """See `AbstractScale`."""
        del t
        return self.unit

    def at_bound(self, t: float) -> bool:
        """See `AbstractScale`."""
        del t
        return False


@dataclasses.dataclass(frozen=True)
class BoundedScale(AbstractScale):
    """Between two bounds, by the logistic function."""

    lower: float = 0.0
    upper: float = 1.0

    def value(self, t: float) -> float:
        """See `AbstractScale`."""
        return self.lower + (self.upper - self.lower) * self._share(t)

    def slope(self, t: float) -> float:
        """See `AbstractScale`."""
        share = self._share(t)
        return (self.upper - self.lower) * share * (1 - share)

    def at_bound(self, t: float) -> bool:
        """See `AbstractScale`."""
        return not NEXT < self._share(t) < 1 - NEXT

    def _share(self, t: float) -> float:
        first = (self.start - self.lower) / (self.upper - self.lower)
        logit = math.log(first / (1 - first)) + t
        return 1 / (1 + math.exp(-max(-500.0, min(500.0, logit))))


def scale_of(start: float, lower: float, upper: float, *, unit: float | None) -> AbstractScale:
    """Scale of a value with bounds; with a unit the value itself, as far as there are no bounds.

    The start must not be at a bound.
    """
    if math.isfinite(lower) and math.isfinite(upper):
        return BoundedScale(start, lower, upper)
    if math.isfinite(lower) or math.isfinite(upper):
        return LogScale(start, lower if math.isfinite(lower) else upper)
    if unit is not None:
        return LinearScale(start, unit)
    return LogScale(start)
