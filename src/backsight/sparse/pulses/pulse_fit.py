r"""Fit of pulses whose place, beginning and width are no longer those of a grid.

The white innovations that a pulse explains are :math:`a\, h(\theta)`, with its size a and
:math:`\theta` the place on the line, the beginning and the width, all of them continuous: the force
is drawn on a grid of `PARTS` parts of a sampling period, whose effect on the next state is exact.

.. math:: \min_{a, \theta} \| y - \sum_i a_i h(\theta_i) \|^2

From the best of a coarse grid around what was selected, all pulses are fitted together by
Gauss-Newton (Levenberg-Marquardt with bounds).
"""

import dataclasses
import itertools

import numpy as np
import scipy

from backsight.discrete.exact import zoh
from backsight.estimators.dictionaries import AbstractPulses, ForceLine, MovingLoads
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.sparse._whitened import Whitened
from backsight.types import Array

PARTS = 16
"""Parts of a sampling period on which a force is drawn."""

STEP = 1e-3
"""Change of a variable, as a share of its reach, by which responses are differentiated."""

UNSEEN = 1e-9
"""A pulse that leaves less than this share of the largest square is not told from others."""

Course = AbstractPulses | MovingLoads
"""Dictionaries with a course that is known between the samples."""


@dataclasses.dataclass(frozen=True)
class Pulse:
    """One pulse.

    Parameters
    ----------
    place : float
        Position on the line [m]; of a load that moves, where it comes on the line.
    start, width : float
        Beginning, and width or crossing as the dictionary counts them [samples].
    """

    place: float
    start: float
    width: float

    @property
    def variables(self) -> Array:
        """Place, start and width, (3,)."""
        return np.array([self.place, self.start, self.width])


@dataclasses.dataclass(frozen=True)
class Reach:
    """How far the variables (place, start, width) may move.

    Parameters
    ----------
    lower, upper : (3,) arrays
    """

    lower: Array
    upper: Array

    @property
    def free(self) -> int:
        """How many of the variables may move at all."""
        return int((self.upper > self.lower).sum())


@dataclasses.dataclass(frozen=True)
class PulseDrawing:
    """Responses to pulses of one course, anywhere on a line.

    Parameters
    ----------
    filter : Whitened
    course : AbstractPulses or MovingLoads
    line : ForceLine
    effects : (PARTS, nx, forces) array
        What a force over one part of a sample adds to the next state.
    sign : float
        1 or -1 if sizes are not negative or not positive, else 0.
    """

    filter: Whitened
    course: Course
    line: ForceLine
    effects: Array
    sign: float

    @property
    def samples(self) -> int:
        """Samples of the recording."""
        return len(self.filter.y)

    def added(self, pulse: Pulse) -> tuple[Array, Array]:
        """What a pulse of the size one adds to next states (n, nx) and outputs (n, ny)."""
        n, F = self.samples, self.filter.forced.F
        edges = np.linspace(0.0, n, PARTS * n + 1)
        match self.course:
            case MovingLoads():
                d = self.course.moved(edges, start=pulse.start, crossing=pulse.width)
                d = d.reshape(n, PARTS, -1)
                moves = np.tensordot(d, self.effects, axes=([1, 2], [0, 2]))
                return moves, d[:, 0] @ F.T
            case AbstractPulses():
                mean = self.course.means(edges, start=pulse.start, width=pulse.width)
                mean, at = mean.reshape(n, PARTS), self.line.weights(np.array([pulse.place]))[0]
                moves = np.tensordot(mean, np.dot(self.effects, at), axes=1)
                return np.asarray(moves, np.float64), mean[:, :1] * (F @ at)

    def columns(self, pulses: list[Pulse]) -> Array:
        """White innovations of the pulses with the size one, (n ny, pulses)."""
        f, n = self.filter.forced, self.samples
        moves = np.empty((n, len(f.E), len(pulses)))
        seen = np.empty((n, len(f.F), len(pulses)))
        for i, pulse in enumerate(pulses):
            moves[:, :, i], seen[:, :, i] = self.added(pulse)
        return self.filter.explained(moves, seen).reshape(n * len(f.F), len(pulses))


def drawing(
    model: Model, filter_: Whitened, *, course: Course, line: ForceLine, sign: float
) -> PulseDrawing:
    """Work out what a force of a continuous model does within a sample."""
    forced = filter_.forced
    s = forced.system.s
    A, B, _, _ = state_space(forces_as_inputs(model, forced.names))
    A, B = zoh(A, B[:, -len(forced.names) :], dt=s.dt / PARTS)
    effects = [B / s.sx[:, None]]
    for _ in range(PARTS - 1):
        effects.append((A * s.sx / s.sx[:, None]) @ effects[-1])
    return PulseDrawing(filter_, course, line, np.array(effects[::-1]), sign)


@dataclasses.dataclass(frozen=True)
class PulseFit:
    """Pulses that fit best.

    Parameters
    ----------
    pulses : list of Pulse
    sizes : (c,) array
    covariance : (c, 4, c, 4) array
        Of size, place, start and width of every pulse; zero of what is fixed.
    cost : float
        Sum of the squared white innovations that remain.
    """

    pulses: list[Pulse]
    sizes: Array
    covariance: Array
    cost: float

    @property
    def worth(self) -> Array:
        """Squared size by its variance, (c,): how surely a pulse is there."""
        i = np.arange(len(self.sizes))
        return self.sizes**2 / np.maximum(self.covariance[i, 0, i, 0], np.finfo(float).tiny)


def pulse_gains(columns: Array, target: Array, beside: Array, *, sign: float) -> Array:
    """How much of the squared target every column explains that others leave, (columns,)."""
    basis = np.linalg.qr(beside)[0]
    columns = columns - basis @ (basis.T @ columns)
    squares = np.einsum("mi,mi->i", columns, columns)
    seen = squares > UNSEEN * squares.max(initial=0.0)
    product = columns.T @ (target - basis @ (basis.T @ target))
    product = np.where(sign * product < 0, 0.0, product)
    return np.where(seen, product**2 / np.where(seen, squares, 1.0), 0.0)


def fitted(drawn: PulseDrawing, target: Array, first: list[Pulse], reach: list[Reach]) -> PulseFit:
    """Fit sizes and free variables of all pulses together, from a first guess.

    Parameters
    ----------
    drawn : PulseDrawing
    target : (n ny,) array
        White innovations of the recording if no force had acted.
    first : list of Pulse
    reach : list of Reach
        Of every pulse.
    """
    count = len(first)
    lower, upper = (np.array([getattr(r, side) for r in reach]) for side in ("lower", "upper"))
    free = np.flatnonzero((upper > lower).ravel())
    start = np.array([p.variables for p in first])
    sizes = np.linalg.lstsq(drawn.columns(first), target, rcond=None)[0]

    def pulses(z: Array) -> list[Pulse]:
        values = start.ravel().copy()
        values[free] = z[count:]
        return [Pulse(*map(float, row)) for row in values.reshape(-1, 3)]

    def residual(z: Array) -> Array:
        return drawn.columns(pulses(z)) @ z[:count] - target

    def sides(z: Array) -> list[tuple[int, float]]:
        # Not beyond the end of the line, where the response would jump to zero.
        low, high = lower.ravel()[free], upper.ravel()[free]
        step = STEP * (high - low)
        pairs = zip(
            np.maximum(z[count:] - step, low), np.minimum(z[count:] + step, high), strict=True
        )
        return [(int(i), float(to)) for i, pair in zip(free, pairs, strict=True) for to in pair]

    def slopes(z: Array) -> Array:
        here = pulses(z)
        columns = drawn.columns([*here, *(_moved(here[i // 3], i % 3, to) for i, to in sides(z))])
        apart = np.array([to for _, to in sides(z)]).reshape(-1, 2)
        pair = columns[:, count:].reshape(len(target), -1, 2)
        by = (pair[:, :, 1] - pair[:, :, 0]) / np.diff(apart).T * z[free // 3]
        return np.hstack([columns[:, :count], by])

    least, most = 0.0 if drawn.sign > 0 else -np.inf, 0.0 if drawn.sign < 0 else np.inf
    below = np.concatenate([np.full(count, least), lower.ravel()[free]])
    above = np.concatenate([np.full(count, most), upper.ravel()[free]])
    z = scipy.optimize.least_squares(
        residual,
        np.clip(np.concatenate([sizes, start.ravel()[free]]), below, above),
        jac=slopes,
        bounds=(below, above),
        x_scale="jac",
        xtol=1e-10,
        max_nfev=40,
    )
    rows = np.concatenate([4 * np.arange(count), 4 * (free // 3) + 1 + free % 3])
    covariance = np.zeros((4 * count, 4 * count))
    covariance[np.ix_(rows, rows)] = _covariance(slopes(z.x))
    shape = (count, 4, count, 4)
    return PulseFit(pulses(z.x), z.x[:count], covariance.reshape(shape), float(2 * z.cost))


def _covariance(J: Array) -> Array:
    """Of least squares with noise of unit covariance; what is not determined is left out."""
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    found = np.linalg.pinv((J / size).T @ (J / size), rcond=1e-12, hermitian=True)
    return found / np.outer(size, size)


def _moved(pulse: Pulse, variable: int, to: float) -> Pulse:
    values = pulse.variables
    values[variable] = to
    return Pulse(*map(float, values))


def grid(axes: tuple[Array, Array, Array]) -> list[Pulse]:
    """All pulses with a place, a start and a width of the axes."""
    return [Pulse(*map(float, values)) for values in itertools.product(*axes)]
