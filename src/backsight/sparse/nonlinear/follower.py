r"""A filter that follows a recording, and stops where a hit must have been.

An extended Kalman filter predicts the measurements. Where its squared white innovations are too
large over the length of a pulse, a window around that moment is searched for a hit, and if there
was one, the filter goes on from the end of the window.
"""

import collections
import dataclasses
from collections.abc import Callable
from typing import final

import numpy as np

from backsight.estimators.dictionaries import AbstractPulses
from backsight.sparse.nonlinear._window import HitWindow, WindowFit, WindowTrajectory
from backsight.sparse.nonlinear.motion import ForcedMotion, Readings
from backsight.sparse.nonlinear.search import Offered, found_hits
from backsight.types import Array

REACH = 4.0
"""Longest pulses before an alarm in which a hit may have begun."""

FREE = 15
"""Evaluations of a fit without a hit."""

TOLD = 500
"""Samples after which it is said how many are done."""

EIGENVALUES = 1e-12
"""Share of the largest information below which a direction of a covariance is exactly known."""


@dataclasses.dataclass(frozen=True)
class FoundHit:
    """A hit.

    Parameters
    ----------
    begin : int
        First sample of the window.
    window : HitWindow
    fit : WindowFit
    covariance : (variables, variables) array
        Of first state, sizes, beginning and width, for the noise that the window has left.
    without : float
        Cost of the window without a hit.
    rival : float
        That with the best hit at another force.
    """

    begin: int
    window: HitWindow
    fit: WindowFit
    covariance: Array
    without: float
    rival: float


@dataclasses.dataclass(frozen=True)
class Watch:
    """What is looked for, and how.

    Parameters
    ----------
    offered : Offered
        `first` and `last` count from where a window is searched.
    course : AbstractPulses
    beside : tuple of int
    before, after : int
        Samples of a window before and after the moment of the alarm.
    alarm : float
        Mean of the squared white innovations over a pulse that is an alarm.
    gain : float
        Share of what is unexplained by which a hit must lower it.
    """

    offered: Offered
    course: AbstractPulses
    beside: tuple[int, ...]
    before: int
    after: int
    alarm: float
    gain: float


@dataclasses.dataclass(frozen=True)
class FollowedMotion:
    """A recording that was followed, scaled, forces in their own unit.

    Between the hits it is what the filter says; over the window of a hit, what the window says.

    Parameters
    ----------
    hits : list of FoundHit
        In the order of time.
    x, spread : (n, nx) arrays
        States after their measurements, and their variances.
    e, S : (n, ny), (n, ny, ny) arrays
        Innovations and their covariances; over a window what the hit leaves.
    d, d_spread : (n, nf) arrays
        Forces of the hits, and their variances.
    """

    hits: list[FoundHit]
    x: Array
    spread: Array
    e: Array
    S: Array
    d: Array
    d_spread: Array

    @classmethod
    def of(cls, samples: int, *, nx: int, ny: int, nf: int) -> "FollowedMotion":
        """Nothing yet."""
        x, e, d = ((samples, m) for m in (nx, ny, nf))
        S = np.zeros((*e, ny))
        return cls([], np.zeros(x), np.zeros(x), np.zeros(e), S, np.zeros(d), np.zeros(d))

    def add(self, hit: FoundHit, path: WindowTrajectory) -> None:
        """Take in a hit with its window."""
        self.hits.append(hit)
        part = slice(hit.begin, hit.begin + len(path.e))
        self.x[part], self.spread[part] = path.x[:-1], path.spread[:-1]
        self.e[part], self.S[part] = path.e, path.S
        self.d[part], self.d_spread[part] = path.d, path.d_spread


def follower(
    motion: ForcedMotion, data: Readings, watch: Watch, *, progress: Callable[[int], None]
) -> FollowedMotion:
    """Follow a recording; `progress` is told the number of samples done."""
    work = _Follower(motion, data, watch)
    work.run(progress)
    return work.found


@final
class _Follower:
    """Where the filter is, what it remembers, and what was found."""

    def __init__(self, motion: ForcedMotion, data: Readings, watch: Watch) -> None:
        self.motion, self.data, self.watch = motion, data, watch
        s, forces = motion.forced.system.s, len(motion.forced.names)
        self.found = FollowedMotion.of(len(data.y), nx=len(s.x0), ny=data.y.shape[1], nf=forces)
        self.restart(0, s.x0, s.P0)

    def restart(self, at: int, x: Array, P: Array) -> None:
        """Go on from a sample with a prediction of its state."""
        self.at, self.x, self.P = at, x, P
        self.past: collections.deque[tuple[Array, Array]] = collections.deque(
            maxlen=self.watch.before + 1
        )
        longest = self.watch.course.lasts * max(self.watch.course.lengths)
        self.surprise: collections.deque[tuple[float, int]] = collections.deque(maxlen=longest)
        self.quiet = at + self.watch.before

    def run(self, progress: Callable[[int], None]) -> None:
        """To the end of the recording."""
        n = len(self.data.y)
        while self.at < n:
            if self.at % TOLD == 0:
                progress(self.at)
            self.past.append((self.x, self.P))
            self.sample()
            if self.at < self.quiet or self.level() < self.watch.alarm:
                continue
            hit = self.look()
            if hit is None:
                self.quiet = self.at + self.watch.after
                continue
            path = hit.window.trajectory(hit.fit, hit.covariance)
            self.found.add(hit, path)
            self.restart(hit.begin + len(path.e), path.x[-1], path.P_end)
        progress(n)

    def level(self) -> float:
        """Mean of the squared white innovations lately."""
        squares, counts = (sum(column) for column in zip(*self.surprise, strict=True))
        return squares / counts if counts else 0.0

    def sample(self) -> None:
        """One step of the filter, from prediction to prediction."""
        forced, k, found = self.motion.forced, self.at, self.found
        white, noise = self.data.root[k], self.data.noise[k]
        v = self.motion.inputs(self.data.u[k : k + 1], np.zeros((1, len(forced.names))))
        m = self.motion.slopes_along(self.x[None], v)
        A, E = m.A[0], m.E[0] * forced.sigma
        C, F = m.C[0], m.F[0] * forced.sigma
        x = self.motion.next(self.x[None], v)[0]
        P = A @ self.P @ A.T + forced.system.s.Q + E @ E.T
        e = self.data.y[k] - self.motion.outputs(self.x[None], v)[0]
        S = C @ self.P @ C.T + F @ F.T + noise
        found.x[k], found.spread[k], found.e[k], found.S[k] = self.x, np.diag(self.P), e, S
        seen = np.flatnonzero(np.diag(white))
        if len(seen):
            white = white[np.ix_(seen, seen)]
            root = np.linalg.cholesky(white @ S[np.ix_(seen, seen)] @ white.T)
            e = np.linalg.solve(root, white @ e[seen])
            CP, FE = white @ C[seen] @ self.P, white @ F[seen] @ E.T
            now, gain = np.linalg.solve(root, CP), np.linalg.solve(root, CP @ A.T + FE)
            found.x[k] += e @ now
            found.spread[k] -= (now**2).sum(axis=0)
            x, P = x + e @ gain, P - gain.T @ gain
            self.surprise.append((float(e @ e), len(seen)))
        else:
            self.surprise.append((0.0, 0))
        self.x, self.P, self.at = x, (P + P.T) / 2, k + 1

    def look(self) -> FoundHit | None:
        """Search the window around where the filter is; nothing if no hit explains it."""
        w, now = self.watch, self.at
        begin, end = now - len(self.past) + 1, min(now + w.after, len(self.data.y))
        mean, P = self.past[0]
        window = HitWindow(
            self.motion, self.data.between(begin, end), mean, _root(P), w.course, w.beside
        )
        reach = int(REACH * w.course.lasts * max(w.course.lengths))
        first = max(now - begin - reach, 1)
        before = window.upto(first).fit(mean, None, tries=FREE)
        without = window.fit(before.x0, None, tries=FREE)
        offered = dataclasses.replace(w.offered, first=float(first), last=float(now - begin))
        best, *others = found_hits(window, before.x0, offered)
        if best.cost > (1 - w.gain) * without.cost:
            return None
        rows, variables = best.slope.shape
        spread = max(best.cost / max(rows - variables, 1), 1.0)
        rival = others[0].cost if others else without.cost
        return FoundHit(begin, window, best, spread * _inverse(best.slope), without.cost, rival)


def _root(P: Array) -> Array:
    """Root of the inverse of a covariance; what is exactly known is known to rounding."""
    values, vectors = np.linalg.eigh(P)
    floor = EIGENVALUES * max(values.max(), np.finfo(float).tiny)
    return (vectors / np.sqrt(np.maximum(values, floor))).T


def _inverse(slope: Array) -> Array:
    """Covariance of least squares; what is not determined does not count."""
    size = np.linalg.norm(slope, axis=0)
    size = np.where(size > 0, size, 1.0)
    own = np.linalg.pinv((slope / size).T @ (slope / size), rcond=1e-12, hermitian=True)
    return own / np.outer(size, size)
