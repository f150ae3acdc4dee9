r"""Noise whose size is an input of the model, so that it can be tried without compiling.

.. math:: Q(u) = Q + \sum_j u_{a(j)} u_{b(j)} Q_j, \qquad
    Q_c(u) = Q_c + \sum_j u_{a(j)} u_{b(j)} Q_{c,j}, \qquad R(u) = \sum_j u_{a(j)} u_{b(j)} R_j

The inputs are factors of standard deviations, a = b, or entries of the root of a covariance.
`backsight.tune.fit` makes them of a `Noise` and keeps them constant over a recording; they are no
part of what a user describes.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from backsight.description import Description, Sound
from backsight.errors import TuningError
from backsight.estimators.uncertainty import Noise
from backsight.models.model import Model
from backsight.types import Array


@dataclasses.dataclass(frozen=True)
class NoisePart(Description):
    """Noise that inputs multiply, physical units.

    Parameters
    ----------
    factors : (str, str)
        Inputs of the model whose product multiplies it: twice the factor of its standard deviation,
        or two entries of the root of the covariance.
    Q, Qc : (nx, nx) array
        Covariance per sample, or spectral density, at the factors 1.
    R : (ny, ny) array
        Covariance of the measurement noise; all parts together are all of it.
    """

    factors: tuple[str, ...]
    Q: Array | None = None
    Qc: Array | None = None
    R: Array | None = None

    def conflicts(self, sound: Sound) -> Iterator[str]:
        """See `Description.conflicts`."""
        if sound("factors") and len(self.factors) != 2:
            yield "a part of the noise: give two factors"
        if sum(k is not None for k in (self.Q, self.Qc, self.R)) != 1:
            yield "a part of the noise: give one of Q, Qc, R"


@dataclasses.dataclass(frozen=True)
class VariedNoise(Noise):
    """Noise with parts that inputs multiply; `Q` and `Qc` are what they do not multiply."""

    parts: tuple[NoisePart, ...] = ()

    def beyond(self, able: Sequence[str]) -> str:
        """Which noise a method does not take, whose `varies_noise` these are; empty if all."""
        if "Q" not in able or self.beyond_additive:
            return "process"
        of_sensors = any(part.R is not None for part in self.parts)
        return "measurement" if of_sensors and "R" not in able else ""


@dataclasses.dataclass(frozen=True)
class ScaledPart:
    """A `NoisePart` in scaled variables; `index` are the places of its factors among the inputs."""

    index: tuple[int, int]
    Q: Array
    Qc: Array
    R: Array

    @property
    def factor(self) -> int:
        """The input that is the factor of its standard deviation.

        Raises
        ------
        TuningError
            If it is a product of two.
        """
        if self.index[0] != self.index[1]:
            raise TuningError("correlations of noise cannot be inputs here")
        return self.index[0]


def scaled_parts(noise: Noise, model: Model, sx: Array, sy: Array) -> tuple[ScaledPart, ...]:
    """Parts of a noise for a model with these scales; none of a plain `Noise`.

    Raises
    ------
    TuningError
        If a factor is no input of the model, or a covariance does not fit it.
    """
    if not isinstance(noise, VariedNoise):
        return ()
    inputs = [s.name for s in model.inputs]

    def matrix(given: Array | None, scale: Array) -> Array:
        size = len(scale)
        if given is None:
            return np.zeros((size, size))
        if given.shape != (size, size):
            raise TuningError(
                f"a part of the noise has the shape {given.shape}, not {(size, size)}"
            )
        return given / np.outer(scale, scale)

    found = []
    for part in noise.parts:
        for factor in part.factors:
            if factor not in inputs:
                raise TuningError(f"the model has no input '{factor}' to multiply noise")
        first, second = (inputs.index(factor) for factor in part.factors)
        matrices = matrix(part.Q, sx), matrix(part.Qc, sx), matrix(part.R, sy)
        found.append(ScaledPart((first, second), *matrices))
    return tuple(found)


def noise_at(constant: Array, parts: Sequence[tuple[tuple[int, int], Array]], u: Any) -> Any:
    """Covariance at inputs u, SX or MX: a constant, and parts by the index of their factors."""
    moving = [(index, Q) for index, Q in parts if Q.any()]
    if not moving:
        return ca.DM(constant)
    v = ca.SX.sym("u", u.numel())
    total = ca.SX(ca.sparsify(ca.DM(constant)))
    for index, Q in moving:
        total += v[index[0]] * v[index[1]] * ca.SX(ca.sparsify(ca.DM(Q)))
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
