r"""A window around one hit: its first state, and when, how long and how hard the hit was.

.. math:: \min \|L (x_0 - \bar x)\|^2 + \sum_k \|R_k^{-1/2} (y_k - h(x_k, u_k, d_k))\|^2, \quad
    x_{k+1} = f(x_k, u_k, d_k), \quad d_k = \sum_j e_j a_j p_k(\theta)

with the sizes a of the forces that the hit moves, and beginning and width :math:`\theta` of its
pulse p. Derivatives are those of the linearised motion; the steps are those of a trust region
(Branch, Coleman, Li 1999, doi:10.1137/S1064827595289108, as in SciPy).
"""

import dataclasses
from functools import cached_property

import numpy as np
import scipy

from backsight.estimators.dictionaries import AbstractPulses
from backsight.sparse.nonlinear.motion import ForcedMotion, Readings
from backsight.types import Array

STEP = 0.02
"""Change of beginning and width by which pulses are differentiated, as a share of the width."""

SETTLED = 1e-3
"""Share of the cost by which a step must lower it, or the fit has settled."""


@dataclasses.dataclass(frozen=True)
class HitPulse:
    """One hit.

    Parameters
    ----------
    force : int
        Number of the force.
    start, width : float
        Of the pulse [samples].
    sizes : tuple of float
        Of this force and of those beside it [their units].
    """

    force: int
    start: float
    width: float
    sizes: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class WindowFit:
    """A window as it fits best.

    Parameters
    ----------
    x0 : (nx,) array
        First state, scaled.
    hit : HitPulse or None
    cost : float
    slope : (rows, variables) array
        Derivatives of the residuals by first state, sizes, beginning and width.
    """

    x0: Array
    hit: HitPulse | None
    cost: float
    slope: Array


@dataclasses.dataclass(frozen=True)
class WindowTrajectory:
    """What a fit says of every sample of its window, scaled, forces in their own unit.

    Parameters
    ----------
    x, spread : (n + 1, nx) arrays
        States up to the one behind the window, and their variances.
    P_end : (nx, nx) array
        Covariance of the state behind the window.
    e, S : (n, ny), (n, ny, ny) arrays
        What the measurements leave, and how large that may be.
    d, d_spread : (n, nf) arrays
        Forces, and their variances.
    """

    x: Array
    spread: Array
    P_end: Array
    e: Array
    S: Array
    d: Array
    d_spread: Array


@dataclasses.dataclass(frozen=True)
class HitWindow:
    """Data of a window, and what is known before.

    Parameters
    ----------
    motion : ForcedMotion
    data : Readings
    mean : (nx,) array
        First state as it is expected, scaled.
    information : (nx, nx) array
        L: root of the information about it.
    course : AbstractPulses
    beside : tuple of int
        Forces that a hit may move at the same time, wherever it is.
    """

    motion: ForcedMotion
    data: Readings
    mean: Array
    information: Array
    course: AbstractPulses
    beside: tuple[int, ...]

    def upto(self, last: int) -> "HitWindow":
        """The same window with an earlier end."""
        return dataclasses.replace(self, data=self.data.between(0, last))

    @property
    def samples(self) -> int:
        """Length of the window."""
        return len(self.data.y)

    @cached_property
    def _rows(self) -> np.ndarray:
        return np.einsum("kii->ki", self.data.root).astype(bool)

    def pulse(self, start: float, width: float) -> Array:
        """Course of a pulse of the size one, (n,)."""
        edges = np.arange(self.samples + 1.0)
        return self.course.means(edges, start=start, width=width)

    def moved(self, hit: HitPulse) -> tuple[int, ...]:
        """Forces that a hit moves."""
        return (hit.force, *self.beside)

    def forces(self, hit: HitPulse | None) -> Array:
        """Forces (n, nf) of a hit."""
        d = np.zeros((self.samples, len(self.motion.forced.names)))
        if hit is not None:
            mean = self.pulse(hit.start, hit.width)
            for force, size in zip(self.moved(hit), hit.sizes, strict=True):
                d[:, force] += size * mean
        return d

    def residuals(self, x0: Array, hit: HitPulse | None) -> Array:
        """What the measurements leave, and what is known of the first state, white."""
        v = self.motion.inputs(self.data.u, self.forces(hit))
        y = self.motion.outputs(self.motion.states(x0, v)[:-1], v)
        left = np.einsum("kij,kj->ki", self.data.root, self.data.y - y)[self._rows]
        return np.concatenate([left, self.information @ (x0 - self.mean)])

    def slope(self, x0: Array, hit: HitPulse | None) -> Array:
        """Derivatives of `residuals` by first state, sizes, beginning and width."""
        shown, _ = self._carried(x0, hit)
        rows = -(self.data.root @ shown)[self._rows]
        many = rows.shape[1] - len(x0)
        known = np.hstack([self.information, np.zeros((len(self.information), many))])
        return np.vstack([rows, known])

    def _carried(self, x0: Array, hit: HitPulse | None) -> tuple[Array, Array]:
        """Derivatives of outputs (n, ny, variables) and states (n + 1, nx, variables)."""
        v = self.motion.inputs(self.data.u, self.forces(hit))
        m = self.motion.slopes_along(self.motion.states(x0, v)[:-1], v)
        changes = self._changes(hit)
        nx, many = len(x0), changes.shape[2]
        moves, seen = m.E @ changes, m.F @ changes
        x = np.empty((self.samples + 1, nx, nx + many))
        x[0] = np.hstack([np.eye(nx), np.zeros((nx, many))])
        for k in range(self.samples):
            x[k + 1] = m.A[k] @ x[k]
            x[k + 1, :, nx:] += moves[k]
        shown = m.C @ x[:-1]
        shown[:, :, nx:] += seen
        return shown, x

    def trajectory(self, fit: WindowFit, covariance: Array) -> "WindowTrajectory":
        """The window as it was fitted, sample by sample, with a covariance of its variables."""
        v = self.motion.inputs(self.data.u, self.forces(fit.hit))
        x, nx = self.motion.states(fit.x0, v), len(fit.x0)
        y = self.motion.outputs(x[:-1], v)
        shown, moved = self._carried(fit.x0, fit.hit)
        changes = self._changes(fit.hit)
        return WindowTrajectory(
            x=x,
            spread=np.einsum("kia,ab,kib->ki", moved, covariance, moved, optimize=True),
            P_end=moved[-1] @ covariance @ moved[-1].T,
            e=self.data.y - y,
            S=self.data.noise + shown @ covariance @ shown.transpose(0, 2, 1),
            d=self.forces(fit.hit),
            d_spread=np.einsum(
                "kfa,ab,kfb->kf", changes, covariance[nx:, nx:], changes, optimize=True
            ),
        )

    def _changes(self, hit: HitPulse | None) -> Array:
        """Forces by sizes, beginning and width, (n, nf, variables)."""
        nf = len(self.motion.forced.names)
        if hit is None:
            return np.zeros((self.samples, nf, 0))
        moved, step = self.moved(hit), STEP * hit.width
        mean, found = self.pulse(hit.start, hit.width), []
        for force in moved:
            one = np.zeros((self.samples, nf))
            one[:, force] = mean
            found.append(one)
        for a, b in ((step, 0.0), (0.0, step)):
            ends = [self.pulse(hit.start + s * a, hit.width + s * b) for s in (-1, 1)]
            by = np.zeros((self.samples, nf))
            for force, size in zip(moved, hit.sizes, strict=True):
                by[:, force] += size * (ends[1] - ends[0]) / (2 * step)
            found.append(by)
        return np.stack(found, axis=2)

    def fit(self, x0: Array, hit: HitPulse | None, *, tries: int, sign: float = 0.0) -> WindowFit:
        """Best first state and hit near these, by so many evaluations at most.

        Parameters
        ----------
        x0 : (nx,) array
        hit : HitPulse or None
        tries : int
        sign : float
            1 or -1 if the size of the hit must not be negative or positive.
        """
        nx, lengths = len(x0), self.course.lengths
        low, high = np.full(nx, -np.inf), np.full(nx, np.inf)
        z = x0
        if hit is not None:
            free = np.full(len(self.beside), np.inf)
            early = hit.start - self.course.lasts * max(lengths)
            late = hit.start + self.course.lasts * max(lengths)
            # A width that is known has no room: a hair of it keeps the bounds apart.
            room = (min(lengths) * (1 - 1e-6), max(lengths) * (1 + 1e-6))
            sized = (0.0 if sign > 0 else -np.inf), (0.0 if sign < 0 else np.inf)
            low = np.concatenate([low, [sized[0]], -free, [early, room[0]]])
            high = np.concatenate([high, [sized[1]], free, [late, room[1]]])
            z = np.concatenate([x0, hit.sizes, [hit.start, hit.width]])

        def apart(z: Array) -> tuple[Array, HitPulse | None]:
            if hit is None:
                return z, None
            sizes = tuple(map(float, z[nx:-2]))
            return z[:nx], HitPulse(hit.force, float(z[-2]), float(z[-1]), sizes)

        found = scipy.optimize.least_squares(
            lambda z: self.residuals(*apart(z)),
            np.clip(z, low, high),
            jac=lambda z: self.slope(*apart(z)),
            bounds=(low, high),
            x_scale="jac",
            ftol=SETTLED,
            max_nfev=tries,
        )
        return WindowFit(*apart(found.x), cost=2 * float(found.cost), slope=found.jac)
