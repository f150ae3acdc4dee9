"""Judge the hits that were found by the hammer's own signal."""

import dataclasses

import numpy as np

from backsight.analysis.forces import matches
from backsight_studies.frame_hammer.source import Hammer

ISOLATED = 0.15
"""A hit is isolated if there is no other one within this time [s]."""

EDGE = 0.1
"""And if the recording goes on for so long before and after it [s]."""

TOLERANCE = 5e-3
"""Of the time of a hit [s]; the clocks of hammer and accelerometers agree within 1 to 3 ms."""


@dataclasses.dataclass(frozen=True)
class Score:
    """How many hits were found where and when they were.

    Parameters
    ----------
    isolated : int
        Isolated hits.
    found : int
        Of these, how many were found in time.
    right : int
        Of these, how many at the right height.
    false : int
        Hits that were found where there is none.
    reported : int
        All hits that were found.
    latest : float
        Largest error of time of the isolated ones [s].
    scatter : float
        Standard deviation of found over true impulse, relative to its mean.
    scale : float
        That mean.
    """

    isolated: int
    found: int
    right: int
    false: int
    reported: int
    latest: float
    scatter: float
    scale: float

    @property
    def share_right(self) -> float:
        """Isolated hits at the right time and height."""
        return self.right / self.isolated if self.isolated else float("nan")

    @property
    def share_false(self) -> float:
        """False alarms among all that is reported."""
        return self.false / self.reported if self.reported else 0.0


def judged(found: Hammer, hammer: Hammer, *, begin: float, end: float) -> Score:
    """Compare what was found in a recording from `begin` to `end` [s] with the hammer."""
    paired = matches(hammer.time, found.time, tolerance=TOLERANCE)
    alone = isolated(hammer, begin, end)
    true, given = np.array([p for p in paired.pairs if alone[p[0]]], int).reshape(-1, 2).T
    ratios = np.abs(found.impulse[given]) / hammer.impulse[true]
    late = np.abs(found.time[given] - hammer.time[true])
    known = len(true) > 0
    return Score(
        isolated=int(alone.sum()),
        found=len(true),
        right=int((np.abs(found.height[given] - hammer.height[true]) < 1e-6).sum()),
        false=len(paired.false),
        reported=len(found.time),
        latest=float(late.max()) if known else float("nan"),
        scatter=float(ratios.std() / ratios.mean()) if known else float("nan"),
        scale=float(ratios.mean()) if known else float("nan"),
    )


def isolated(hammer: Hammer, begin: float, end: float) -> np.ndarray:
    """Which hits are isolated, (n,)."""
    time = hammer.time
    apart = np.abs(time[:, None] - time) + np.where(np.eye(len(time)), np.inf, 0.0)
    alone = apart.min(axis=1, initial=np.inf) >= ISOLATED
    return alone & (time >= begin + EDGE) & (time <= end - EDGE)
