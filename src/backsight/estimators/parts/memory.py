"""What an estimator keeps from sample to sample, by names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from backsight.engine.loops import PIECE, all_finite
from backsight.engine.recursion import Channel, Recursion
from backsight.errors import EngineError
from backsight.schema import Status
from backsight.types import Array

Value = ca.MX | ca.DM | Array | float


class Memory:
    """The carry of a recursion: parts with names, instead of places in a vector.

    ``m = Memory(x=x0, P=P0, called=0)`` says what is kept, and what it is before the first sample;
    ``m.x`` is the symbol of a part during a step, in the shape of its start value. `recursion`
    takes the values for the next sample under the same names.

    Parameters
    ----------
    **parts : array or number
        Start values; (n,) arrays are columns, matrices stay matrices.

    Raises
    ------
    EngineError
        If a name is that of a method, or a start value has more than two dimensions.
    """

    def __init__(self, **parts: ArrayLike) -> None:
        self._start = {name: np.asarray(value, dtype=np.float64) for name, value in parts.items()}
        taken = sorted(name for name in parts if name.startswith("_") or hasattr(type(self), name))
        deep = sorted(name for name, value in self._start.items() if value.ndim > 2)
        if taken or deep:
            raise EngineError(
                f"the memory cannot have a part '{(taken or deep)[0]}': "
                + ("the name is taken" if taken else "it has more than two dimensions")
            )
        ends = np.cumsum([0, *(value.size for value in self._start.values())])
        self._symbol = ca.MX.sym("carry", int(ends[-1]))
        pieces = ca.vertsplit(self._symbol, [int(end) for end in ends])
        self._parts = {
            name: ca.reshape(piece, *_shape(value))
            for (name, value), piece in zip(self._start.items(), pieces, strict=True)
        }

    def __getattr__(self, name: str) -> ca.MX:
        """Symbol of a part."""
        parts: dict[str, ca.MX] = self.__dict__.get("_parts", {})
        if name not in parts:
            raise AttributeError(f"the memory has no part '{name}', but {', '.join(parts)}")
        return parts[name]

    @property
    def symbol(self) -> ca.MX:
        """The whole memory during a step, flat."""
        return self._symbol

    @property
    def start(self) -> Array:
        """The whole memory before the first sample, flat."""
        return np.concatenate([v.ravel(order="F") for v in self._start.values()])

    def parts(self, memory: Array) -> dict[str, Array]:
        """Parts of a flat memory in numbers, by name and in the shape of their start values."""
        found, at = {}, 0
        for name, value in self._start.items():
            piece = memory[at : at + value.size]
            found[name], at = piece.reshape(value.shape, order="F"), at + value.size
        return found

    def joined(self, parts: Mapping[str, Value]) -> ca.MX:
        """All parts, given by name, as the flat memory.

        Raises
        ------
        EngineError
            If a part is missing, unknown, or of another shape than its start value.
        """
        problems = [f"'{name}' is missing" for name in self._start if name not in parts]
        problems += [f"there is no '{name}'" for name in parts if name not in self._start]
        values = {name: ca.MX(parts[name]) for name in self._start if name in parts}
        for name, value in values.items():
            shape = _shape(self._start[name])
            if value.shape != shape:
                problems.append(f"'{name}' has the shape {value.shape} instead of {shape}")
        if problems:
            raise EngineError("memory of the next sample: " + "; ".join(problems))
        return ca.vertcat(*(ca.vec(ca.densify(value)) for value in values.values()))

    def recursion(
        self,
        name: str,
        data: Sequence[ca.MX],
        *,
        next: Mapping[str, Value] | ca.MX,  # noqa: A002 - it reads as it is meant
        outputs: Mapping[str, Value],
        channels: Sequence[Channel],
        dt: float,
        least_samples: int = 1,
        lag: int = 0,
        innovation: ca.Function | None = None,
    ) -> Recursion:
        """Put a step together.

        Parameters
        ----------
        name : str
            Of the step.
        data : sequence of MX
            Symbols of u, y and mask.
        next : dict, or MX
            Every part for the coming sample, by name; or the flat memory that `joined` made.
        outputs : dict
            Name of a channel to its value.
        channels : sequence of Channel
            What the outputs are, in the order of the recursion.
        dt, least_samples, lag, innovation
            See `Recursion`.

        Raises
        ------
        EngineError
            If a part or an output is missing, unknown or of the wrong size.
        """
        names = [channel.name for channel in channels]
        wrong = [f"'{n}' is missing" for n in names if n not in outputs]
        wrong += [f"there is no channel '{n}'" for n in outputs if n not in names]
        if wrong:
            raise EngineError(f"outputs of '{name}': " + "; ".join(wrong))
        after = next if isinstance(next, ca.MX) else self.joined(next)
        if after.shape != self._symbol.shape:
            raise EngineError(
                f"memory of the next sample of '{name}': {after.shape} instead of "
                f"{self._symbol.shape}"
            )
        named = {n: ca.vec(ca.densify(ca.MX(outputs[n]))) for n in names}
        if {"x_hat", "P", "status"} <= set(named):
            told = _not_finite(named["x_hat"].numel())
            named["status"] = told(named["x_hat"], named["P"], named["status"])
        values = [named[n] for n in names]
        return Recursion(
            step=ca.Function(name, [self._symbol, *data], [after, *values]),
            carry0=self.start,
            channels=tuple(channels),
            dt=dt,
            least_samples=least_samples,
            lag=lag,
            innovation=innovation,
        )


def diagonal_of_triangle(n: int) -> list[int]:
    """Places of the diagonal in the lower triangle of a matrix with n rows."""
    return np.cumsum([0, *range(n, 1, -1)]).tolist()


def _not_finite(n: int) -> ca.Function:
    """``(x_hat, P, status) -> status``, with the bit `NOT_FINITE` where one is no number.

    Other bits that could not be told either are left out.
    """
    finite, status = ca.SX.sym("finite"), ca.SX.sym("status")
    known = ca.if_else(ca.fabs(status) < np.inf, status, 0)
    raised = ca.if_else(finite, known, known + int(Status.NOT_FINITE))
    if 2 * n <= PIECE:  # one function costs half of what four of them cost on a controller
        x, P = ca.SX.sym("x", n), ca.SX.sym("P", n * (n + 1) // 2)
        sizes = ca.norm_1(ca.vertcat(x, P[diagonal_of_triangle(n)]))
        told = ca.substitute(raised, finite, sizes < np.inf)
        return ca.Function("status_if_not_finite", [x, P, status], [told])
    told = ca.Function("told_if_not_finite", [finite, status], [raised])
    x, P, given = ca.MX.sym("x", n), ca.MX.sym("P", n * (n + 1) // 2), ca.MX.sym("status")
    found = told(all_finite(ca.vertcat(x, P[diagonal_of_triangle(n)])), given)
    return ca.Function("status_if_not_finite", [x, P, given], [found])


def _shape(value: Array) -> tuple[int, int]:
    if value.ndim == 2:
        return value.shape[0], value.shape[1]
    return value.size, 1
