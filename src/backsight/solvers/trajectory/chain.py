"""Sizes and constants of a linear window, and the symbols of one sample of it."""

import dataclasses
from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech, vech
from backsight.engine.dense import UNROLL, triangle, unpacked
from backsight.types import Array

VIOLATED = 1e4
"""A hard limit that is violated by more than so many of its rounding errors is not held."""

ROOM = 1e-12
"""Share of a row's variance below which it counts as fixed by what was imposed before."""


@dataclasses.dataclass(frozen=True)
class Chain:
    """Sizes and constants of a window.

    Parameters
    ----------
    N : int
        Number of transitions.
    Q : (nx, nx) array
        Covariance of the noise of a transition.
    F : casadi.Sparsity
        Of the transition matrix.
    H : casadi.Sparsity
        Of the derivative of the whitened outputs, (ny, nx).
    noise : (n, nx) array
        Rows of limits on the noise; zero for limits on the state.
    A : casadi.Sparsity
        Of the rows of limits on the state, (n, nx).
    softness : (n,) array
        Variance of the limits; 0 for hard ones.
    slack : (n,) array
        Violations below this are rounding errors.
    exact : tuple of int
        Limits that are equations wherever they have an end, whatever their sides: readings of
        sensors without noise.
    parts : tuple of (nx, nx) arrays
        Covariances of noise that numbers of the sample multiply, beside `Q`: ``before`` has 1 where
        there is a transition to it, and then these numbers.
    """

    N: int
    Q: Array
    F: ca.Sparsity
    H: ca.Sparsity
    noise: Array
    A: ca.Sparsity
    softness: Array
    slack: Array
    exact: tuple[int, ...] = ()
    parts: tuple[Array, ...] = ()

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.Q)

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return self.H.size1()

    @property
    def n(self) -> int:
        """Number of limits at a sample."""
        return len(self.softness)

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of what describes a sample, in the order of the functions here."""
        return {
            "F": self.F.nnz(), "c": self.nx, "before": 1 + len(self.parts),
            "H": self.H.nnz(), "e": self.ny, "A": self.A.nnz(), "low": self.n, "high": self.n,
        }  # fmt: skip

    @property
    def inputs(self) -> dict[str, int]:
        """Lengths of a sample's description, its active limits and multipliers of the others."""
        return self.sizes | {"side": self.n, "force": self.n}

    @property
    def records(self) -> dict[str, int]:
        """Lengths of what the forward pass keeps of a sample, see `smoother.filtered`."""
        nx, ny, n = self.nx, self.ny, self.n
        return {
            "delta": nx, "P": self.size_P, "K": nx * n, "nu": n, "g": n,
            "K_y": nx * ny, "nu_y": ny, "g_y": ny * ny if self.dense else ny, "conflict": n,
            "size": n,
        }  # fmt: skip

    @property
    def dense(self) -> bool:
        """Whether covariances are whole matrices and loops, for many states."""
        return self.nx > UNROLL

    @property
    def size_P(self) -> int:
        """Length of a covariance: the lower triangle, or the whole matrix for many states."""
        return self.nx * self.nx if self.dense else self.nx * (self.nx + 1) // 2

    def stored(self, P: Array) -> Array:
        """A covariance as it is stored."""
        return P.ravel() if self.dense else P.T[np.triu_indices(self.nx)]

    def matrix(self, stored: ca.SX) -> ca.SX:
        """A stored covariance as a matrix."""
        return ca.reshape(stored, self.nx, self.nx) if self.dense else unvech(stored)

    def variances(self, stored: ca.MX) -> ca.MX:
        """Diagonal (nx,) of a stored covariance."""
        if self.dense:
            return stored[:: self.nx + 1]
        return stored[np.cumsum([0, *range(self.nx, 1, -1)]).tolist()]

    def moving_noise(self, before: ca.SX) -> ca.SX:
        """Covariance of the noise of the transition to a sample."""
        first, *rest = (before[k] * constant(part) for k, part in enumerate(self._noises))
        return sum(rest, first)

    def noise_along(self, before: ca.SX, eta: ca.SX) -> ca.SX:
        """Noise (nx,) of the transition to a sample, in terms of its adjoint."""
        noises = enumerate(self._noises)
        first, *rest = (before[k] * (constant(part) @ eta) for k, part in noises)
        return sum(rest, first)

    @property
    def _noises(self) -> tuple[Array, ...]:
        return self.Q, *self.parts

    def triangle(self) -> ca.Function:
        """From a stored covariance to its lower triangle."""
        if self.dense:
            stored = ca.MX.sym("P", self.size_P)
            return ca.Function(
                "triangle", [stored], [triangle(ca.reshape(stored, self.nx, self.nx))]
            )
        P = ca.SX.sym("P", self.size_P)
        return ca.Function("triangle", [P], [vech(self.matrix(P))])

    def whole(self) -> ca.Function:
        """From the lower triangle of a covariance to how it is stored."""
        if self.dense:
            given = ca.MX.sym("P", self.nx * (self.nx + 1) // 2)
            return ca.Function("whole", [given], [ca.vec(unpacked(given, self.nx))])
        P = ca.SX.sym("P", self.nx * (self.nx + 1) // 2)
        return ca.Function("whole", [P], [P])

    def window(self) -> list[ca.MX]:
        """Symbols of the first sample's mean and covariance and of the description of all."""
        start = [ca.MX.sym("delta", self.nx), ca.MX.sym("P", self.size_P)]
        return start + [ca.MX.sym(k, size, self.N + 1) for k, size in self.sizes.items()]


@dataclasses.dataclass(frozen=True)
class Stage:
    """Symbols of one sample, in SX, and which limits are equations."""

    F: ca.SX
    c: ca.SX
    before: ca.SX
    H: ca.SX
    e: ca.SX
    A: ca.SX
    low: ca.SX
    high: ca.SX
    side: ca.SX
    force: ca.SX
    exact: tuple[int, ...]

    @classmethod
    def of(cls, chain: Chain) -> "Stage":
        """Symbols for a window's samples."""
        symbols = {name: ca.SX.sym(name, size) for name, size in chain.inputs.items()}
        return cls(**symbols, exact=chain.exact)

    @property
    def symbols(self) -> list[ca.SX]:
        """All of them, in the order of `Chain.inputs`."""
        return [getattr(self, f.name) for f in dataclasses.fields(self)[:-1]]

    def active(self, r: int) -> ca.SX:
        """Whether row r is at a limit; a side where there is no limit does not count."""
        if r in self.exact:
            return self.low[r] > -np.inf
        at_low = ca.logic_and(self.side[r] > 0, self.low[r] > -np.inf)
        return ca.logic_or(at_low, ca.logic_and(self.side[r] < 0, self.high[r] < np.inf))

    def target(self, r: int) -> ca.SX:
        """Value that row r is set to, 0 if it is free."""
        at_low = ca.SX(1) if r in self.exact else self.side[r] > 0
        limit = ca.if_else(at_low, self.low[r], self.high[r])
        return ca.if_else(self.active(r), limit, 0)


def naming(name: str, inputs: Sequence[ca.MX], results: Mapping[str, ca.MX]) -> ca.Function:
    """Build a function whose results have names."""
    places = [f"i{k}" for k in range(len(inputs))]
    return ca.Function(name, [*inputs], [*results.values()], places, [*results])


def by_name(function: ca.Function, arguments: Sequence[ca.MX]) -> dict[str, ca.MX]:
    """Results of a function by their names."""
    return dict(zip(function.name_out(), function.call(arguments), strict=True))


def constant(matrix: Array) -> ca.SX:
    """A matrix of numbers, without its zeros."""
    return ca.SX(ca.sparsify(ca.DM(matrix)))
