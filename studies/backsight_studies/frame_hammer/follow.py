"""Follow the swinging beam through a recording, from hit to hit.

The study's own: when a hit is looked for, when it is believed and when the beam counts as lost is
decided by shares of the energy that were chosen on the signals of its rig. An estimator of the
library weighs residuals by the noise that is stated and says how sure it is; here the errors of the
model are larger than the noise, and nobody can state them.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from backsight.types import Array
from backsight_studies.frame_hammer.rig import HEIGHTS, LSB, SUBSTEPS, WIDTHS, Axis
from backsight_studies.frame_hammer.search import Found, search
from backsight_studies.frame_hammer.window import Fit, Pulse, Window, advanced

SAMPLES = 56
"""In a window without a hit."""

ADVANCE = 20
"""Samples from one window to the next."""

LOOK = 44
"""Samples after the newest ones that are added when a hit is looked for."""

MARGIN = 10
"""Samples by which a hit may lie before the newest ones."""

SETTLED = 8
"""Samples after a hit at which the next window begins."""

GOOD, LOST = 0.06, 0.35
"""Unexplained share of the energy of a window that is usual, and at which the beam is lost."""

CLEAR = 0.015
"""Unexplained share at which no other start is tried."""

RISE = 2.5
"""A hit is looked for when the unexplained share rises by this factor."""

GAIN = 0.5
"""A hit must lower what is unexplained to this share."""

QUIET = 3.5 * LSB
"""Energy per sample below which all is noise [m/s2]."""

SCALES, TRIES, SPREAD = (1.0, 2.0, 3.0, 5.0), 4, 25.0
"""Starts without knowledge: factors to a linear fit, and random amplitudes of the modes that the
sampling cannot show well [m/s2]."""

HIDDEN = 10
"""Unknowns from here on belong to those modes."""


@dataclasses.dataclass(frozen=True)
class Hit:
    """A hit that was found.

    Parameters
    ----------
    sample : float
        When, in samples.
    height : float
        Where [m].
    impulse : float
        How hard [N s]; its sign is the direction.
    width : int
        Number of the pulse.
    shares : (heights,) array
        Explained share of the energy of the window with the hit at each of the `HEIGHTS`.
    without : float
        The same without a hit.
    """

    sample: float
    height: float
    impulse: float
    width: int
    shares: Array
    without: float

    @property
    def margin(self) -> float:
        """Unexplained energy of the second best height over that of the best."""
        best, second = np.sort(1 - self.shares)[:2]
        return float(second / best)


@dataclasses.dataclass(frozen=True)
class Piece:
    """The motion from a sample on, until the next piece begins."""

    start: int
    fit: Fit
    pulses: tuple[Pulse, ...]
    share: float


@dataclasses.dataclass(frozen=True)
class Track:
    """All hits and the motion between them.

    Parameters
    ----------
    axis : Axis
    hits : tuple of Hit
    pieces : tuple of Piece
    lost : int
        Samples of which no motion was found.
    """

    axis: Axis
    hits: tuple[Hit, ...]
    pieces: tuple[Piece, ...]
    lost: int

    @property
    def free(self) -> list[Piece]:
        """Pieces without a hit."""
        return [piece for piece in self.pieces if not piece.pulses]


def unexplained(y: Array, cost: float) -> float:
    """Share of the energy of the signals."""
    energy = ((y - y.mean(axis=1, keepdims=True)) ** 2).sum()
    return float(cost / max(energy, y.size * QUIET**2))


@final
class _Follower:
    """Follows one recording; collects hits and pieces on the way."""

    def __init__(self, axis: Axis, y: Array, widths: Sequence[int]) -> None:
        self.axis, self.y, self.widths = axis, y, widths
        self.short = Window(axis, SAMPLES)
        self.long = Window(axis, SAMPLES + ADVANCE + LOOK)
        self.hits: list[Hit] = []
        self.pieces: list[Piece] = []
        self.lost = 0

    def signals(self, start: int, window: Window) -> Array:
        """Samples of a window."""
        return self.y[:, start : start + window.samples]

    def room(self, start: int, window: Window) -> bool:
        """Whether a window ends before the recording does."""
        return start + window.samples <= self.y.shape[1]

    def acquire(self, start: int) -> Piece | None:
        """Find the motion without knowing it, at the first window where that is possible."""
        while self.room(start, self.short):
            fit = first_fit(self.short, self.signals(start, self.short))
            share = unexplained(self.signals(start, self.short), fit.cost)
            if share < GOOD:
                return Piece(start, fit, (), share)
            self.lost += ADVANCE
            start += ADVANCE
        return None

    def at(self, start: int, modes: Array, iterations: int) -> Piece:
        """Window with free motion near the predicted one."""
        y = self.signals(start, self.short)
        fit = self.short.fit(y, self.short.beginning(y, modes), iterations=iterations)
        return Piece(start, fit, (), unexplained(y, fit.cost))

    def next(self, piece: Piece) -> Piece | None:
        """The window after a piece, behind a hit if there is one."""
        start = piece.start + ADVANCE
        if not self.room(start, self.short):
            return None
        modes = advanced(self.axis, piece.fit, ADVANCE * SUBSTEPS)
        after = self.at(start, modes, 8)
        if after.share < max(RISE * piece.share, GOOD / 4) and after.share < GOOD * 2:
            return after
        behind = self.behind_hit(piece) if self.room(piece.start, self.long) else None
        if behind is not None:
            return behind
        return after if after.share < LOST else self.acquire(start + SAMPLES)

    def behind_hit(self, piece: Piece) -> Piece | None:
        """Window behind a hit within the newest samples, None if there is none."""
        y = self.signals(piece.start, self.long)
        head = y[:, :SAMPLES]
        start = self.short.beginning(head, piece.fit.modes)
        before = self.short.fit(head, start, iterations=4)
        without = self.long.fit(y, before, iterations=8)
        heights = search(
            self.long,
            y,
            before,
            first=SAMPLES - MARGIN,
            last=SAMPLES + ADVANCE,
            widths=self.widths,
        )
        best = min(heights, key=lambda found: found.fit.cost)
        if best.fit.cost > GAIN * without.cost:
            return None
        self.hits.append(self.hit(piece.start, y, heights, without))
        self.pieces.append(
            Piece(piece.start, best.fit, (best.pulse,), unexplained(y, best.fit.cost))
        )
        return self.settled(piece.start, best)

    def settled(self, start: int, found: Found) -> Piece | None:
        """First window behind a hit."""
        samples = int(np.ceil(found.pulse.middle / SUBSTEPS)) + SETTLED
        modes = advanced(self.axis, found.fit, samples * SUBSTEPS, (found.pulse,))
        if not self.room(start + samples, self.short):
            return None
        piece = self.at(start + samples, modes, 15)
        return piece if piece.share < LOST else self.acquire(start + samples + ADVANCE)

    def hit(self, start: int, y: Array, heights: list[Found], without: Fit) -> Hit:
        """What was found, for the list."""
        costs = [found.fit.cost for found in heights]
        best = heights[int(np.argmin(costs))]
        return Hit(
            start + best.pulse.middle / SUBSTEPS,
            HEIGHTS[best.pulse.height],
            float(best.fit.hits[0]),
            best.pulse.width,
            np.array([1 - unexplained(y, c) for c in costs]),
            1 - unexplained(y, without.cost),
        )


def first_fit(window: Window, y: Array, *, seed: int = 0) -> Fit:
    """Motion in a window of which nothing is known."""
    rng, linear = np.random.default_rng(seed), window.linear(y)
    best = window.beginning(y, linear)
    for scale in SCALES:
        for k in range(TRIES):
            modes = scale * linear
            if k:
                modes[HIDDEN:] = SPREAD * rng.standard_normal(len(modes) - HIDDEN)
            tried = window.fit(y, window.beginning(y, modes), iterations=25)
            best = min(best, tried, key=lambda fit: fit.cost)
            if unexplained(y, best.cost) < CLEAR:
                return best
    return best


def follow(
    axis: Axis,
    y: Array,
    *,
    widths: Sequence[int] = tuple(range(len(WIDTHS))),
    progress: Callable[[float], None] = lambda _share: None,
) -> Track:
    """Find all hits in a recording.

    Parameters
    ----------
    axis : Axis
        Direction in which the beam was hit.
    y : (n, 4) array
        Accelerations as recorded [m/s2].
    widths : sequence of int
        Numbers of the pulses that a hit may have.
    progress : callable
        Told the share of the recording that is done.
    """
    work = _Follower(axis, np.ascontiguousarray(y.T, float), widths)
    piece = work.acquire(0)
    while piece is not None:
        work.pieces.append(piece)
        progress(piece.start / len(y))
        piece = work.next(piece)
    return Track(axis, tuple(work.hits), tuple(work.pieces), work.lost)
