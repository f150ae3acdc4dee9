"""The modes of a model over a range of states: eigenvalues, and the states that move in them."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import overload

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from backsight.engine.building import built_alone
from backsight.models.model import Model
from backsight.types import Array

MANY = 100
"""With more states the Jacobian is looked at in fewer places."""

REACH = 2.0
"""Standard deviations to either side of the prior's mean that count as its range."""


@dataclasses.dataclass(frozen=True)
class Modes:
    """Modes of a linearised model.

    Parameters
    ----------
    values : (m,) complex array
        Eigenvalues [1/s].
    names : sequence of str
        What moves most in every one.
    """

    values: NDArray[np.complex128]
    names: Sequence[str]

    def told(self, k: int) -> str:
        """Mode k in words."""
        value = complex(self.values[k])
        shown = f"{value.real:.4g}{value.imag:+.4g}j" if value.imag else f"{value.real:.4g}"
        return f"the mode of {self.names[k]} (eigenvalue {shown} 1/s)"

    def __add__(self, other: Modes) -> Modes:
        """Both together."""
        return Modes(np.append(self.values, other.values), (*self.names, *other.names))


NO_MODES = Modes(np.zeros(0, complex), ())


def modes_at(model: Model, x: Array, u: Array) -> Modes:
    """Modes of a continuous model at points (n, nx) with inputs (n, nu).

    Points at which the Jacobian is not finite do not count.
    """
    return _modes(_jacobian(model)[0], x, u, model)


def modes_over(model: Model, x0: Array, deviation: Array) -> Modes:
    """Modes of a continuous model over the range of a prior.

    Parameters
    ----------
    model : Model
    x0, deviation : (nx,) arrays
        Mean and standard deviations. The Jacobian is taken there and, inside the bounds, `REACH`
        deviations to either side in every state on which it depends; for inputs of zero and of
        plus and minus their scale, if it depends on them.
    """
    if not model.continuous:
        return NO_MODES
    jacobian, of_x, of_u = _jacobian(model)
    lower = np.array([s.lower for s in model.states])
    upper = np.array([s.upper for s in model.states])
    moved = np.diag(REACH * deviation)[of_x]
    if model.nx > MANY:
        moved = moved.sum(axis=0, keepdims=True)
    points = np.vstack([x0, np.clip(x0 + moved, lower, upper), np.clip(x0 - moved, lower, upper)])
    scale = np.array([s.scale or 1.0 for s in model.inputs]) * of_u
    inputs = np.unique([0 * scale, scale, -scale], axis=0)
    pairs = list(itertools.product(np.unique(points, axis=0), inputs))
    x, u = (np.array(side) for side in zip(*pairs, strict=True))
    return _modes(jacobian, x, u, model)


@functools.lru_cache(maxsize=16)
@built_alone
def _jacobian(model: Model) -> tuple[ca.Function, NDArray[np.bool_], NDArray[np.bool_]]:
    """``(x, u) -> (nx, nx)``, and the states and inputs on which it depends."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    J = ca.densify(ca.jacobian(ca.SX(model.rhs(x, u)), x))
    entries = ca.vec(J)
    of_x, of_u = (
        np.array(ca.which_depends(entries, z, 1, False), bool) if z.numel() else np.zeros(0, bool)
        for z in (x, u)
    )
    return ca.Function("jacobian", [x, u], [J]), of_x, of_u


@functools.lru_cache(maxsize=16)
@built_alone
def _at_many(jacobian: ca.Function, count: int) -> ca.Function:
    return jacobian.map(count)


def _modes(jacobian: ca.Function, x: Array, u: Array, model: Model) -> Modes:
    n, count = model.nx, len(x)
    every = np.array(_at_many(jacobian, count)(x.T, u.T)).reshape(n, count, n).transpose(1, 0, 2)
    finite = every[np.isfinite(every).all(axis=(1, 2))]
    if not len(finite):
        return NO_MODES
    # Of a linear model all are the same.
    matrices = finite[:1] if (finite == finite[0]).all() else finite
    values = np.linalg.eigvals(matrices).astype(complex)
    return Modes(values.ravel(), _Movers(matrices, tuple(s.name for s in model.states)))


@dataclasses.dataclass(frozen=True)
class _Movers(Sequence[str]):
    """What moves most in every mode of matrices (m, n, n); found out when it is asked for."""

    matrices: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.matrices) * len(self.names)

    @overload
    def __getitem__(self, k: int) -> str: ...
    @overload
    def __getitem__(self, k: slice) -> tuple[str, ...]: ...
    def __getitem__(self, k: int | slice) -> str | tuple[str, ...]:
        if isinstance(k, slice):
            return tuple(self[i] for i in range(*k.indices(len(self))))
        which, mode = divmod(range(len(self))[k], len(self.names))
        values, vectors = np.linalg.eig(self.matrices[which])
        # The order is that of `eigvals`, but for rounding: the nearest one.
        wanted = np.linalg.eigvals(self.matrices[which])[mode]
        nearest = int(np.argmin(np.abs(values - wanted)))
        # Participation factors, which do not depend on the units of the states.
        share = np.abs(vectors[:, nearest] * np.linalg.pinv(vectors)[nearest])
        return f"'{self.names[int(share.argmax())]}'"
