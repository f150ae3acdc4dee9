"""Motion profiles: S-curves from rest to rest, put together to sequences that may repeat."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.errors import BacksightError
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Motion:
    """Position, velocity and acceleration at some times, arrays of one shape.

    Examples
    --------
    >>> half = bs.signals.quintic(0.0, 0.1, duration=2.0).at([0.0, 1.0])
    >>> half.position.round(3), half.velocity.round(3)
    (array([0.  , 0.05]), array([0.   , 0.094]))
    """

    position: Array
    velocity: Array
    acceleration: Array


@dataclasses.dataclass(frozen=True)
class Profile:
    """A position over time, made of polynomials.

    Parameters
    ----------
    path : scipy.interpolate.PPoly
        Position over time from 0 on.
    repeats : bool
        After its end the profile begins anew; otherwise it stays at its end.
    """

    path: "scipy.interpolate.PPoly"
    repeats: bool = False

    @property
    def duration(self) -> float:
        """Length, or period [s]."""
        return float(self.path.x[-1])

    @property
    def start(self) -> float:
        """First position."""
        return float(self.path(0.0))

    @property
    def end(self) -> float:
        """Last position."""
        return float(self.path(self.duration))

    def at(self, time: ArrayLike) -> Motion:
        """Position, velocity and acceleration at times from 0 on [s]."""
        t = np.asarray(time, float)
        if not (np.isfinite(t).all() and (t >= 0).all()):
            raise BacksightError("a profile begins at time 0: times must be finite and >= 0")
        inside = np.mod(t, self.duration) if self.repeats else np.minimum(t, self.duration)
        moving = np.ones_like(t) if self.repeats else (t < self.duration).astype(float)
        position, velocity, acceleration = (np.asarray(self.path(inside, k)) for k in range(3))
        return Motion(position, velocity * moving, acceleration * moving)


def quintic(start: float, end: float, *, duration: float) -> Profile:
    r"""S-curve that is smooth to the second derivative.

    .. math:: r(t) = a + (b - a) (10 s^3 - 15 s^4 + 6 s^5), \qquad s = t / T

    Its greatest speed is 15/8 of the mean, its greatest acceleration :math:`10/\sqrt 3` times
    :math:`(b - a) / T^2`.

    Parameters
    ----------
    start, end : float
        Positions at rest, a and b.
    duration : float
        T [s].

    Raises
    ------
    BacksightError
        If an argument is not finite or the duration is not positive.

    Examples
    --------
    >>> bs.signals.quintic(0.0, 0.1, duration=2.0).duration
    2.0
    """
    _positive(duration=duration)
    _finite(start=start, end=end)
    c = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) * (end - start)
    c = c / duration ** np.arange(5, -1, -1)
    c[-1] = start
    return Profile(scipy.interpolate.PPoly(c[:, None], np.array([0.0, duration])))


def jerk_limited(
    start: float, end: float, *, speed: float, acceleration: float, jerk: float
) -> Profile:
    """Fastest S-curve within bounds on speed, acceleration and jerk.

    Up to seven pieces of constant jerk; those that the bounds do not need are left out.

    Parameters
    ----------
    start, end : float
        Positions at rest.
    speed, acceleration, jerk : float
        Bounds, in units of position per s, s2 and s3.

    Raises
    ------
    BacksightError
        If an argument is not finite, a bound is not positive, or start and end are the same.

    References
    ----------
    Lambrechts, Boerlage, Steinbuch, "Trajectory planning and feedforward design for
    electromechanical motion systems", Control Engineering Practice 13 (2005), 145-157.

    Examples
    --------
    >>> stroke = bs.signals.jerk_limited(0.0, 0.1, speed=0.5, acceleration=5.0, jerk=200.0)
    >>> print(f"{stroke.duration:.3f} s")
    0.325 s
    """
    _positive(speed=speed, acceleration=acceleration, jerk=jerk)
    _finite(start=start, end=end)
    distance = abs(end - start)
    if distance == 0:
        raise BacksightError(f"an S-curve from {start:g} to {end:g} does not move: use `rest`")
    rise = min(np.cbrt(distance / (2 * jerk)), np.sqrt(speed / jerk), acceleration / jerk)
    peak = jerk * rise
    by_distance = np.sqrt(rise**2 / 4 + distance / peak) - 1.5 * rise
    hold = max(0.0, min(by_distance, speed / peak - rise))
    cruise = max(0.0, distance / (peak * (rise + hold)) - (2 * rise + hold))
    lengths = np.array([rise, hold, rise, cruise, rise, hold, rise])
    jerks = jerk * np.sign(end - start) * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    needed = lengths > 1e-9 * rise
    breaks = np.concatenate([[0.0], np.cumsum(lengths[needed])])
    path = scipy.interpolate.PPoly(jerks[None, needed], breaks).antiderivative(3)
    return Profile(scipy.interpolate.PPoly(path.c + start * (np.arange(4) == 3)[:, None], breaks))


def rest(position: float, *, duration: float) -> Profile:
    """Stand still.

    Examples
    --------
    >>> bs.signals.rest(0.1, duration=2.0).duration
    2.0
    """
    _positive(duration=duration)
    _finite(position=position)
    return Profile(scipy.interpolate.PPoly(np.array([[position]]), np.array([0.0, duration])))


def sequence(profiles: Sequence[Profile], *, repeats: bool = False) -> Profile:
    """One profile after the other.

    Parameters
    ----------
    profiles : sequence of Profile
        Each begins where the one before ends.
    repeats : bool
        Begin anew after the last one, which must then end where the first begins.

    Raises
    ------
    BacksightError
        If there is no profile or a position jumps.

    Examples
    --------
    >>> there, back = (
    ...     bs.signals.quintic(0.0, 0.1, duration=2.0),
    ...     bs.signals.quintic(0.1, 0.0, duration=1.0),
    ... )
    >>> bs.signals.sequence([there, back]).duration
    3.0
    """
    if not profiles:
        raise BacksightError("a sequence needs at least one profile")
    following = [*profiles[1:], profiles[0]] if repeats else profiles[1:]
    span = max(abs(p) for profile in profiles for p in (profile.start, profile.end))
    for i, (one, next_one) in enumerate(zip(profiles, following, strict=False)):
        if abs(one.end - next_one.start) > 1e-9 * span:
            raise BacksightError(
                f"profile {i} ends at {one.end:g}, but the next one begins at {next_one.start:g}"
            )
    degree = max(len(p.path.c) for p in profiles)
    pieces = [np.pad(p.path.c, ((degree - len(p.path.c), 0), (0, 0))) for p in profiles]
    begins = np.cumsum([0.0, *(p.duration for p in profiles)])
    breaks = [p.path.x[:-1] + begin for p, begin in zip(profiles, begins, strict=False)]
    return Profile(
        scipy.interpolate.PPoly(np.hstack(pieces), np.concatenate([*breaks, begins[-1:]])), repeats
    )


def punch_strokes() -> Profile:
    """Motion of a punch [m]: a slow full stroke, then fast small ones, over and over.

    Up and down again by 4 mm in 38 ms each, with a rest of 2 ms (12.5 Hz, up to 197 mm/s), then
    two cycles of 1 mm at 50 Hz (up to 188 mm/s); the period is 120 ms.

    Examples
    --------
    >>> print(f"{bs.signals.punch_strokes().duration:.3f} s")
    0.120 s
    """
    low, high, small = -2e-3, 2e-3, -1e-3
    full = [
        quintic(low, high, duration=0.038),
        rest(high, duration=0.002),
        quintic(high, low, duration=0.038),
        rest(low, duration=0.002),
    ]
    fast = [quintic(low, small, duration=0.01), quintic(small, low, duration=0.01)]
    return sequence([*full, *fast, *fast], repeats=True)


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise BacksightError(f"{name} is {value}; it must be positive")


def _finite(**values: float) -> None:
    for name, value in values.items():
        if not np.isfinite(value):
            raise BacksightError(f"{name} is {value}; it must be finite")
