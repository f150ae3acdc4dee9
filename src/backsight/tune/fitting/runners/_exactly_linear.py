r"""Many settings of the Kalman filter of a linear time-invariant model: nothing is traced.

Matrices are all there is of such a model, and the filter over a recording is one kernel
(`matrix_innovations`), which is called once for every setting. Noise is a sum of parts,

.. math:: Q = Q_0 + \sum_j f_{a(j)} f_{b(j)} Q_j, \qquad R = \sum_j f_{a(j)} f_{b(j)} R_j ,

each carried to discrete time once. What inputs do to state and outputs is computed beside.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from backsight.description import Kept, content
from backsight.discrete.noise import integrated_noise
from backsight.errors import ModelError, TuningError
from backsight.estimators.base import AbstractEstimator
from backsight.estimators.parts.linear import Linear, linear
from backsight.kernels import library
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.tune.fitting.runners._delays import shifted
from backsight.tune.fitting.runners._free_noise import FreeNoise
from backsight.tune.fitting.runners._lanes import CHUNK, KEPT, Data
from backsight.tune.fitting.values import Unknown, placed, sensor_factors
from backsight.types import Array

KERNEL = "matrix_innovations"

KINDS = {"sigma_y", "R", "walk", "matrix", "sigma_x0", "P0", "x0", "delay"}
"""Kinds of unknowns that are noise, prior, or in the data."""

SETTLING = 100
"""Samples that a covariance takes to come back to itself, roughly."""

MANY = 6000
"""Updates of the covariance from which on lanes, which take several at once, repay their making."""

OF_PRIOR = ("sigma_x0", "P0", "x0")


@dataclasses.dataclass(frozen=True)
class Part:
    """A part of a covariance, scaled, and the numbers whose product multiplies it."""

    index: tuple[int, int]
    of: Array


@dataclasses.dataclass(frozen=True)
class LinearRunner:
    """A Kalman filter of a linear model with noise, prior or delays that are free.

    Parameters
    ----------
    estimator, model : AbstractEstimator, Model
        As given.
    system : Linear
    factors : FreeNoise
    Q : (nx, nx) array
        Of what no factor multiplies, per sample and scaled.
    parts_of_Q, parts_of_R : tuple of Part
        All of R is in parts, or it is that of the system.
    unknowns : tuple of Unknown
    dt : float
    run : callable
        The kernel.
    """

    estimator: AbstractEstimator
    model: Model
    system: Linear
    factors: FreeNoise
    Q: Array
    parts_of_Q: tuple[Part, ...]
    parts_of_R: tuple[Part, ...]
    unknowns: tuple[Unknown, ...]
    dt: float
    run: library.OnArrays

    def innovations(
        self, data: Data, settings: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[Array, Array]]:
        """Innovations and their variances (settings, n, ny) with every setting, piece by piece."""
        s, n = self.system.s, len(data[0])
        nx, ny = s.model.nx, s.model.ny
        noise = [self._noise(values) for values in settings]
        prior = [self._prior(values) for values in settings]
        driven = [self._driven(data, values) for values in self._apart(settings)]
        weights, corrects = _weights(data)
        for first in range(0, n, CHUNK):
            part = slice(first, min(first + CHUNK, n))
            size = part.stop - first
            r, d = (np.empty((len(settings), size, ny)) for _ in range(2))
            shapes = [(ny, size), (ny, size), (nx,), (nx, nx)]
            with library.one_thread():
                for i, (Q, R) in enumerate(noise):
                    b, y = driven[i % len(driven)]
                    rows = [b[part].T, y[part].T, weights[part].T, corrects[part]]
                    given = [self.system.A, self.system.C, Q, R, *prior[i], *rows]
                    *found, x, P = self.run((nx, ny, size), given, shapes)
                    r[i], d[i] = (a.T for a in found)
                    prior[i] = x, P
            yield r * s.sy, d * s.sy**2

    def _apart(self, settings: Sequence[Mapping[str, float]]) -> Sequence[Mapping[str, float]]:
        """Settings whose inputs differ; one if none do."""
        return settings if any(u.kind == "delay" for u in self.unknowns) else settings[:1]

    def _noise(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Q and R, scaled."""
        s, f = self.system.s, self.factors.numbers(values)
        Q = _sum(self.Q, self.parts_of_Q, f)
        R = _sum(np.zeros_like(s.R), self.parts_of_R, f) if self.parts_of_R else s.R
        factor = sensor_factors(self.model, self.unknowns, values)
        return Q, R * np.outer(factor, factor)

    def _prior(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Mean and covariance before the first sample, scaled."""
        s = self.system.s
        changed = [u for u in self.unknowns if u.kind in OF_PRIOR]
        if all(values[u.name] == u.start for u in changed):
            return s.x0, s.P0
        prior = placed(self.estimator, self.model, changed, values)[0].assumed[1]
        mean, P = prior.mean(self.model), prior.covariance(self.model)
        return mean / s.sx, P / np.outer(s.sx, s.sx)

    def _driven(self, data: Data, values: Mapping[str, float]) -> tuple[Array, Array]:
        """What inputs add to the state (n, nx), and outputs without what they add (n, ny)."""
        system, s = self.system, self.system.s
        u = shifted(data[0], self.model, self.dt, self.unknowns, values) / s.su
        b = u @ system.B.T
        if system.ramp:
            b += np.vstack([u[1:], u[-1:]]) @ system.B_next.T
        return b, data[3] / s.sy - u @ system.D.T


def updates_of(data: Data) -> int:
    """About how often a pass computes the covariance anew; elsewhere it stays as it is."""
    weights, corrects = _weights(data)
    rows = np.hstack([weights, corrects.T])
    changes = int((rows[1:] != rows[:-1]).any(axis=1).sum())
    return min(len(rows), SETTLING * (1 + changes))


def linear_runner(
    estimator: AbstractEstimator, model: Model, dt: float, unknowns: Sequence[Unknown]
) -> LinearRunner | None:
    """Make the runner; None if the estimator is no such filter, or more than that is free.

    What was made is kept, as by `lanes_of`.
    """
    found = tuple(unknowns)
    if not _able(estimator, model, found):
        return None
    key = content(estimator, model, dt, found, type(estimator).filters_exactly)
    kept = _made.of(key, lambda: _runner(estimator, model, dt, found))
    return kept and dataclasses.replace(kept, estimator=estimator, model=model)


_made: Kept[LinearRunner | None] = Kept(KEPT)


def _runner(
    estimator: AbstractEstimator, model: Model, dt: float, unknowns: tuple[Unknown, ...]
) -> LinearRunner | None:
    noise, prior = estimator.assumed
    try:
        system = linear(model, dt, noise=noise, prior=prior, hold=estimator.input_hold)
    except (ModelError, TuningError):
        return None
    if not estimator.filters_exactly(system.s):
        return None
    s, factors = system.s, FreeNoise(unknowns)
    varied, names = factors.varied(noise, model), factors.names
    rates = state_space(model)[0] if model.continuous else None

    def sampled(Q: Array | None, Qc: Array | None) -> Array:
        found = np.zeros((model.nx, model.nx)) if Q is None else Q
        if Qc is not None and rates is not None and Qc.any():
            found = found + integrated_noise(rates, Qc, dt=dt)[1]
        return found / np.outer(s.sx, s.sx)

    of_Q, of_R = [], []
    for part in varied.parts:
        index = names.index(part.factors[0]), names.index(part.factors[1])
        if part.R is not None:
            of_R.append(Part(index, part.R / np.outer(s.sy, s.sy)))
        else:
            of_Q.append(Part(index, sampled(part.Q, part.Qc)))
    return LinearRunner(
        estimator=estimator,
        model=model,
        system=system,
        factors=factors,
        Q=sampled(varied.process(model), varied.density(model)),
        parts_of_Q=tuple(of_Q),
        parts_of_R=tuple(of_R),
        unknowns=unknowns,
        dt=dt,
        run=library.on_arrays(KERNEL),
    )


def _able(estimator: AbstractEstimator, model: Model, unknowns: Sequence[Unknown]) -> bool:
    """Whether it is such a filter, nothing else is free, and the kernel is there."""
    unbounded = all(x.lower == -np.inf and x.upper == np.inf for x in model.states)
    positive = any(x.positive for x in model.states)
    plain = all(y.wrap is None and y.saturation is None for y in model.outputs)
    of_noise = all(u.kind in KINDS and not u.late_output for u in unknowns)
    if positive or not (unbounded and plain and of_noise) or estimator.outliers is not None:
        return False
    return not (estimator.assumed[0].beyond_additive or library.missing())


def _sum(constant: Array, parts: Sequence[Part], factors: Sequence[float]) -> Array:
    total = constant.copy()
    for part in parts:
        first, second = part.index
        total += factors[first] * factors[second] * part.of
    return total


def _weights(data: Data) -> tuple[Array, Array]:
    """Weights of the rows (n, ny), and which samples correct (1, n), for the kernel.

    A sample that is hidden from the estimator has the weights with which it is judged.
    """
    _, _, mask, _, judged = data
    seen = np.any(mask > 0, axis=1)
    return np.where(seen[:, None], mask, judged), seen[None].astype(float)
