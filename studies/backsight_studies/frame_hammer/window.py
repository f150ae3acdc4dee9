r"""A window of the recording, seen through clipped sensors.

Within a window the beam swings freely, and a hit adds the response of its modes to a pulse. The raw
accelerations are linear in the unknowns; what the sensors make of them is not,

.. math:: \dot s = \omega_c\,(\mathrm{clip}(a) - s), \qquad y_{jk} = s_j(t_k + j\,\delta) + b_j .

The offsets b are eliminated. The unknowns are found by Levenberg and Marquardt's method (Marquardt,
SIAM J. 11, 1963, doi:10.1137/0111030), a few iterations from each of many starts.

It is the study's own and not general: the motion is the closed form of the modes of one beam, the
hits are half-sine pulses on the sub-steps of one converter, which reads four channels one after the
other. In the library a clipped and lagged sensor is a model (`with_sensors`), channels of other
times are read late, and a window over any model is fitted by the MHE.
"""

import dataclasses
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from backsight.types import Array
from backsight_studies.frame_hammer.rig import STEP, SUBSTEPS, WIDTHS, Axis

POINTS = 16
"""In which the integral over a pulse is taken."""

DAMPING, GROWTH, SMALLEST = 1e-2, 5.0, 1e-5
"""Of the method: at the start, its factor, and at the least."""

CHANNELS = np.arange(4)[:, None]


@dataclasses.dataclass(frozen=True)
class Pulse:
    """A hit: its middle [sub-steps from the start of the window], number of height and width."""

    middle: int
    height: int
    width: int


@dataclasses.dataclass(frozen=True)
class Fit:
    """Unknowns of a window and what remains of the signals.

    Parameters
    ----------
    modes : (2 modes,) array
        Raw acceleration of every mode at the start: real and imaginary part of its amplitude.
    hits : (2 pulses,) array
        Impulse [N s] and twisting impulse of every pulse.
    sensors : (4,) array
        Of the low-passes at the start [m/s2].
    cost : float
        Sum of the squared residuals.
    """

    modes: Array
    hits: Array
    sensors: Array
    cost: float

    @property
    def unknowns(self) -> Array:
        """All in one vector."""
        return np.concatenate([self.modes, self.hits, self.sensors])


@dataclasses.dataclass(frozen=True)
class Window:
    """Windows of one length.

    Parameters
    ----------
    axis : Axis
    samples : int
    """

    axis: Axis
    samples: int

    @property
    def steps(self) -> int:
        """Sub-steps."""
        return self.samples * SUBSTEPS

    @cached_property
    def free(self) -> Array:
        """Raw accelerations of every mode, swinging freely, (2 modes, 4, steps)."""
        swing = np.exp(np.outer(self.axis.poles, STEP * np.arange(self.steps)))
        parts = np.stack([np.real(swing), -np.imag(swing)], axis=1)
        columns = self.axis.seen[:, None, :, None] * parts[:, :, None, :]
        return columns.reshape(2 * self.axis.modes, len(CHANNELS), self.steps)

    @cached_property
    def _fading(self) -> Array:
        """What the state of the low-passes at the start does to the samples, (4, 4, samples)."""
        left = self.axis.memory**self._read
        return np.eye(len(CHANNELS))[:, :, None] * left[None]

    @cached_property
    def _read(self) -> NDArray[np.intp]:
        """Sub-step at which each channel is read, (4, samples)."""
        return SUBSTEPS * np.arange(self.samples) + CHANNELS

    @cached_property
    def _pulses(self) -> tuple[Array, ...]:
        """For every width: responses to a force at every height and to a twist, (rows, 4, t).

        The middle of the pulse is at `lead`.
        """
        return tuple(self._response(width) for width in WIDTHS)

    @property
    def _lead(self) -> int:
        return int(np.ceil(max(WIDTHS) / 2 / STEP)) + 1

    def _response(self, width: float) -> Array:
        axis = self.axis
        time = STEP * (np.arange(self.steps + self._lead) - self._lead)
        # The force itself accelerates; then every mode remembers it.
        phase = time / width + 0.5
        acting = (phase > 0) & (phase < 1)
        force = np.where(acting, np.sin(np.pi * phase), 0.0) * np.pi / (2 * width)
        since = time[:, None] - _moments(width)
        begun = since > 0
        since = np.where(begun, since, 0.0)
        modes = np.stack(
            [
                ((np.exp(p * since) * begun) @ _weights() * p**2).imag / p.imag + force
                for p in axis.poles
            ]
        )
        twist = np.eye(axis.modes)[-1:]
        return np.einsum("hi,ij,it->hjt", np.vstack([axis.driven, twist]), axis.seen, modes)

    def hit(self, pulse: Pulse) -> Array:
        """Raw accelerations of a unit of force and of twist, (2, 4, steps)."""
        return np.stack([self.force(pulse), self._shifted(pulse, -1)])

    def force(self, pulse: Pulse) -> Array:
        """Raw accelerations of a unit of force, (4, steps)."""
        return self._shifted(pulse, pulse.height)

    def _shifted(self, pulse: Pulse, row: int) -> Array:
        response = self._pulses[pulse.width][row]
        out, ahead = np.zeros((len(CHANNELS), self.steps)), pulse.middle - self._lead
        if ahead >= 0:
            out[:, ahead:] = response[:, : self.steps - ahead]
        else:
            out[:] = response[:, -ahead : self.steps - ahead]
        return out

    def columns(self, pulses: tuple[Pulse, ...] = ()) -> Array:
        """Raw accelerations of all unknowns but those of the sensors."""
        return np.concatenate([self.free, *map(self.hit, pulses)]) if pulses else self.free

    def sensed(self, raw: Array) -> Array:
        """Raw signals (..., 4, steps) at the samples, behind low-passes that begin at zero."""
        return low_passed(self.axis, raw)[..., CHANNELS, self._read[:, : raw.shape[-1] // SUBSTEPS]]

    def clipped(self, raw: Array) -> Array:
        """Raw accelerations within the range of the sensors."""
        return np.clip(raw, -self.axis.limit, self.axis.limit)

    def residual(self, y: Array, columns: Array, unknowns: Array) -> Array:
        """Signals (4, samples) minus model, without the offsets."""
        n = len(columns)
        model = self.sensed(self.clipped(np.tensordot(unknowns[:n], columns, 1)))
        return _centred(y - model - np.tensordot(unknowns[n:], self._fading, 1))

    def fading(self, fit: Fit) -> Array:
        """What is left of the state of the low-passes at the start, (4, samples)."""
        return np.tensordot(fit.sensors, self._fading, 1)

    def jacobian(self, columns: Array, unknowns: Array) -> Array:
        """Derivatives of the model, (unknowns, 4 samples)."""
        raw = np.tensordot(unknowns[: len(columns)], columns, 1)
        inside = np.abs(raw) < self.axis.limit
        rows = np.concatenate([self.sensed(columns * inside), self._fading])
        return _centred(rows).reshape(len(rows), -1)

    def beginning(self, y: Array, modes: Array) -> Fit:
        """The given modes with the best state of the sensors."""
        start = np.concatenate([modes, np.zeros(len(CHANNELS))])
        left = self.residual(y, self.free, start)
        rows = _centred(self._fading).reshape(len(CHANNELS), -1)
        sensors = np.linalg.lstsq(rows.T, left.ravel(), rcond=None)[0].astype(float)
        cost = float(((left.ravel() - sensors @ rows) ** 2).sum())
        return Fit(modes, np.zeros(0), sensors, cost)

    def fit(
        self, y: Array, start: Fit, pulses: tuple[Pulse, ...] = (), *, iterations: int = 15
    ) -> Fit:
        """Best unknowns near a start, which has as many pulses."""
        columns, found = self.columns(pulses), start.unknowns
        left = self.residual(y, columns, found)
        cost, damping = float((left**2).sum()), DAMPING
        for _ in range(iterations):
            rows = self.jacobian(columns, found)
            normal, slope = rows @ rows.T, rows @ left.ravel()
            scale = np.diag(normal) + 1e-3 * np.trace(normal) / len(normal) + 1e-12
            better = False
            for _ in range(6):
                step = np.linalg.solve(normal + damping * np.diag(scale), slope)
                tried = self.residual(y, columns, found + step)
                new = float((tried**2).sum())
                better = new < cost
                if better:
                    break
                damping *= GROWTH
            if not better:
                break
            settled = cost - new < 1e-4 * cost
            found, left, cost = found + step, tried, new
            damping = max(damping / GROWTH, SMALLEST)
            if settled:
                break
        n = 2 * self.axis.modes
        return Fit(found[:n], found[n : -len(CHANNELS)], found[-len(CHANNELS) :], cost)

    def linear(self, y: Array) -> Array:
        """Modes as if the sensors had no limit, (2 modes,)."""
        rows = np.concatenate([self.sensed(self.free), self._fading])
        rows = _centred(rows).reshape(len(rows), -1)
        found = np.linalg.lstsq(rows.T, _centred(y).ravel(), rcond=1e-6)[0].astype(float)
        return found[: 2 * self.axis.modes]


def low_passed(axis: Axis, raw: Array) -> Array:
    """Raw signals (..., steps), straight lines between the sub-steps, behind the low-pass."""
    memory = axis.memory
    share = (1 - memory) / 2
    return scipy.signal.lfilter([share, share], [1, -memory], raw, axis=-1)


def advanced(axis: Axis, fit: Fit, steps: int, pulses: tuple[Pulse, ...] = ()) -> Array:
    """Modes after some sub-steps, (2 modes,), when all pulses are over."""
    amplitude = (fit.modes[::2] + 1j * fit.modes[1::2]) * np.exp(axis.poles * steps * STEP)
    for pulse, (impulse, twist) in zip(pulses, fit.hits.reshape(-1, 2), strict=True):
        since = (steps - pulse.middle) * STEP - _moments(WIDTHS[pulse.width])
        memory = np.exp(np.outer(axis.poles, since)) @ _weights()
        drive = impulse * axis.driven[pulse.height] + twist * np.eye(axis.modes)[-1]
        amplitude = amplitude - 1j * axis.poles**2 / axis.poles.imag * memory * drive
    return np.stack([amplitude.real, amplitude.imag], axis=1).ravel()


def _moments(width: float) -> Array:
    """Points of a pulse, relative to its middle [s]."""
    return ((np.arange(POINTS) + 0.5) / POINTS - 0.5) * width


def _weights() -> Array:
    half_sine = np.sin(np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    return half_sine / half_sine.sum()


def _centred(values: Array) -> Array:
    return values - values.mean(axis=-1, keepdims=True)
