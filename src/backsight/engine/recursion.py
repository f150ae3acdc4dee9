"""A recursion: one pure function of fixed size that is applied to sample after sample."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.algebra.symmetric import side
from backsight.description import Description, Whole
from backsight.engine.loops import all_finite, iterate
from backsight.schema import Status
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class Channel(Description):
    """One output of a recursion.

    Parameters
    ----------
    name : str
    dims : tuple of str
        Dimensions of one sample's value, () for a number; two for a square matrix.
    symmetric : bool
        The value is the lower triangle of a symmetric matrix with dimensions `dims`.
    labels : tuple of str
        Names along the dimension, where the caller does not know them.
    ago : int
        What is held between the samples is about the interval that began so many samples earlier.
    """

    name: str
    dims: tuple[str, ...] = ()
    symmetric: bool = False
    labels: tuple[str, ...] = ()
    ago: Whole = 0

    def unpack(self, values: Array) -> Array:
        """Values of all samples (n, length) in the shape of `dims`."""
        if not self.dims:
            return values[:, 0]
        if self.symmetric:
            values = np.take(values, self.entries(values.shape[1]).ravel(), axis=1)
        if len(self.dims) < 2:
            return values
        m = math.isqrt(values.shape[1])
        return values.reshape(len(values), m, m)

    def entries(self, length: int) -> NDArray[np.intp]:
        """Where the entries of a symmetric matrix are in its triangle of this length, (m, m)."""
        m = side(length)
        rows, columns = np.triu_indices(m)
        where = np.empty((m, m), np.intp)
        where[rows, columns] = where[columns, rows] = np.arange(length)
        return where


@dataclasses.dataclass(frozen=True)
class Recursion:
    """A step function with its memory.

    Parameters
    ----------
    step : casadi.Function
        ``(carry, *data) -> (carry, *outputs)``, all of them dense column vectors.
    carry0 : (nc,) array
        The memory before the first sample.
    channels : tuple of Channel
        What the outputs are, in order.
    dt : float
        Sampling period [s].
    least_samples : int
        A shorter recording does not fill a window without which the method is not itself.
    lag : int
        The outputs of a step are about the sample so many steps ago.
    innovation : casadi.Function, optional
        ``(carry, *data) -> (e, S)`` of the newest sample, where the outputs ``e`` and ``S`` are
        about an earlier one.
    start : callable, optional
        The memory before the first sample for another prior: ``(x0, P0) -> carry``, physical.
    fresh : (nc,) array, optional
        The memory of a new start after a failure, if that is not `carry0`.
    """

    step: ca.Function
    carry0: Array
    channels: tuple[Channel, ...]
    dt: float
    least_samples: int = 1
    lag: int = 0
    innovation: ca.Function | None = None
    start: Callable[[Array, Array], Array] | None = None
    fresh: Array | None = None

    def restarting(self) -> Recursion:
        """The same, but after a sample that leaves no finite memory it starts anew from `carry0`.

        The status of that sample says *not finite*, even if only what it predicts is not. So it
        does after a sample whose status says *misled*.
        """
        symbols = [ca.MX.sym(f"i{k}", self.step.numel_in(k)) for k in range(self.step.n_in())]
        after, *outputs = self.step.call(symbols, True, False)
        finite, status = ca.SX.sym("finite"), ca.SX.sym("status")
        gone = 1 - finite
        raised = status + int(Status.NOT_FINITE) * gone * (1 - _told(status, Status.NOT_FINITE))
        lost = ca.logic_or(gone, _told(status, Status.MISLED))
        judge = ca.Function("lost", [finite, status], [lost, raised])
        where = [c.name for c in self.channels].index("status")
        lost, outputs[where] = judge(all_finite(after), outputs[where])
        size = len(self.carry0)
        go, old, fresh = (ca.MX.sym(n, k) for n, k in (("go", 1), ("old", size), ("fresh", size)))
        anew = ca.Function("anew", [go, old, fresh], [ca.MX(0), fresh])
        again = self.carry0 if self.fresh is None else self.fresh
        _, kept = iterate(anew, 1, carry=[lost, after], constants=[ca.MX(again)])
        step = ca.Function(self.name, symbols, [kept, *outputs])
        return dataclasses.replace(self, step=step)

    def without(self, channel: str) -> Recursion:
        """The same without an output."""
        kept = [k for k, c in enumerate(self.channels) if c.name != channel]
        symbols = [ca.MX.sym(f"i{k}", self.step.numel_in(k)) for k in range(self.step.n_in())]
        after, *outputs = self.step.call(symbols, True, False)
        step = ca.Function(self.name, symbols, [after, *(outputs[k] for k in kept)])
        channels = tuple(self.channels[k] for k in kept)
        return dataclasses.replace(self, step=step, channels=channels)

    @property
    def name(self) -> str:
        """Name of the step function."""
        return self.step.name()

    @property
    def input_sizes(self) -> tuple[int, ...]:
        """Lengths of the data vectors of one sample."""
        return tuple(self.step.numel_in(i) for i in range(1, self.step.n_in()))

    @property
    def output_sizes(self) -> tuple[int, ...]:
        """Lengths of the output vectors of one sample."""
        return tuple(self.step.numel_out(i) for i in range(1, self.step.n_out()))


def _told(status: ca.SX, bit: Status) -> ca.SX:
    """1 if the bit is set, else 0."""
    half = ca.floor(status / int(bit))
    return half - 2 * ca.floor(half / 2)


@dataclasses.dataclass(frozen=True)
class ForwardBackward:
    """A pass from the first sample to the last, and one back that takes what the first handed on.

    Parameters
    ----------
    forward : Recursion
        ``(carry, u, y, mask) -> (carry, *outputs)``; the first outputs are for the way back, the
        others are results.
    backward : Recursion
        ``(carry, *handed, u, u_next, y, mask) -> (carry, *outputs)``, from the last sample to the
        first; `u_next` is the input of the sample after.
    weights : int, optional
        Output of the forward pass by which the mask of the backward pass is multiplied.
    """

    forward: Recursion
    backward: Recursion
    weights: int | None = None

    @property
    def handed(self) -> int:
        """Number of outputs of the forward pass that the backward pass takes."""
        return len(self.backward.input_sizes) - len(self.forward.input_sizes) - 1
