r"""Process noise whose size is an input of the model, so that it can be tried without compiling.

.. math:: Q(u) = Q + \sum_j u_{i(j)}^2 \, Q_j, \qquad Q_c(u) = Q_c + \sum_j u_{i(j)}^2 \, Q_{c,j}

The inputs are factors of standard deviations. `backsight.tune.fit` makes them of a `Noise` and
keeps them constant over a recording; they are no part of what a user describes.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.description import Description, Sound
from backsight.errors import TuningError
from backsight.estimators.uncertainty import Noise, covariance
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class NoisePart(Description):
    """Process noise that an input multiplies, physical units.

    Parameters
    ----------
    factor : str
        Input of the model that is the factor of its standard deviation.
    Q, Qc : (nx, nx) array
        Covariance per sample, or spectral density, at the factor 1.
    """

    factor: str
    Q: Array | None = None
    Qc: Array | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        del sound
        if (self.Q is None) == (self.Qc is None):
            yield "a part of the process noise: give either Q or Qc"


@dataclasses.dataclass(frozen=True)
class VariedNoise(Noise):
    """Noise with parts that inputs multiply; `Q` and `Qc` are what they do not multiply."""

    parts: tuple[NoisePart, ...] = ()


@dataclasses.dataclass(frozen=True)
class ScaledPart:
    """A `NoisePart` in scaled variables; `index` is the place of its factor among the inputs."""

    index: int
    Q: Array
    Qc: Array


def scaled_parts(noise: Noise, model: Model, sx: Array) -> tuple[ScaledPart, ...]:
    """Parts of a noise for a model whose states have the scales `sx`; none of a plain `Noise`.

    Raises
    ------
    TuningError
        If a factor is no input of the model, or a covariance does not fit it.
    """
    if not isinstance(noise, VariedNoise):
        return ()
    inputs, nothing = [s.name for s in model.inputs], np.zeros((model.nx, model.nx))

    def matrix(given: Array | None) -> Array:
        if given is None:
            return nothing
        return covariance(given, model.states, what="a part of Q", singular=True) / np.outer(sx, sx)

    for part in noise.parts:
        if part.factor not in inputs:
            raise TuningError(f"the model has no input '{part.factor}' to multiply noise")
    return tuple(ScaledPart(inputs.index(p.factor), matrix(p.Q), matrix(p.Qc)) for p in noise.parts)


def noise_at(constant: Array, parts: Sequence[tuple[int, Array]], u: Any) -> Any:
    """Covariance at inputs u, SX or MX: a constant, and parts by the index of their factor."""
    moving = [(index, Q) for index, Q in parts if Q.any()]
    if not moving:
        return ca.DM(constant)
    v = ca.SX.sym("u", u.numel())
    total = ca.SX(ca.sparsify(ca.DM(constant)))
    for index, Q in moving:
        total += v[index] ** 2 * ca.SX(ca.sparsify(ca.DM(Q)))
    return ca.Function("noise_at", [v], [ca.densify(total)])(u)


def columns_at(constant: Array, parts: Sequence[tuple[int, Array]], u: Any) -> Any:
    """Columns G(u) with G G' the covariance of `noise_at`, where both are given by their roots.

    Parameters
    ----------
    constant : (nx, m) array
        Columns that no input multiplies.
    parts : sequence of (int, (nx, m) array)
    u : SX or MX
    """
    v = ca.SX.sym("u", u.numel())
    blocks = [ca.SX(ca.DM(constant))] if constant.any() or not parts else []
    for index, root in parts:
        blocks.append(v[index] * ca.SX(ca.DM(root[:, root.any(axis=0)])))
    return ca.Function("noise_columns", [v], [ca.densify(ca.horzcat(*blocks))])(u)
