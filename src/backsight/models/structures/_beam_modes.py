r"""Natural vibrations of a uniform Euler-Bernoulli beam, in a form that holds for every mode.

With :math:`\xi = x / L` a shape is written in functions none of which exceeds one,

.. math::
    \varphi(\xi) = a \cos\lambda\xi + b \sin\lambda\xi
        + c\, e^{-\lambda \xi} + d\, e^{-\lambda (1 - \xi)},

and not in hyperbolic functions: from the tenth mode on, their differences lose all digits.

Source: Blevins, "Formulas for Natural Frequency and Mode Shape", 1979, table 8-1.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike

from backsight.errors import ModelError
from backsight.types import Array


def _sech(z: float) -> float:
    return 2 * math.exp(-z) / (1 + math.exp(-2 * z))


@dataclasses.dataclass(frozen=True)
class Boundary:
    """How a beam is held.

    Parameters
    ----------
    left, right : tuple of int
        Derivatives of the shape that vanish at the ends (0 deflection, 1 slope, 2 moment, 3 shear).
    rigid : int
        Number of motions without bending.
    characteristic : callable
        (lambda, tip mass over mass of the beam) to a number of the order of lambda, zero at modes.
    before : float
        The first root lies between this and one more, in units of pi, each further one in the next
        interval.
    """

    left: tuple[int, int]
    right: tuple[int, int]
    rigid: int
    characteristic: Callable[[float, float], float]
    before: float


BoundaryName: TypeAlias = Literal["cantilever", "pinned-pinned", "free-free", "clamped-clamped"]
"""How a beam may be held, by the names in `BOUNDARIES`."""

BOUNDARIES: dict[BoundaryName, Boundary] = {
    "cantilever": Boundary(
        (0, 1),
        (2, 3),
        0,
        lambda z, tip: (
            _sech(z) + math.cos(z) + z * tip * (math.cos(z) * math.tanh(z) - math.sin(z))
        ),
        0.0,
    ),
    "pinned-pinned": Boundary((0, 2), (0, 2), 0, lambda z, _: math.sin(z), 0.5),
    "free-free": Boundary((2, 3), (2, 3), 2, lambda z, _: math.cos(z) - _sech(z), 1.0),
    "clamped-clamped": Boundary((0, 1), (0, 1), 0, lambda z, _: math.cos(z) - _sech(z), 1.0),
}
"""The ways a beam may be held, by name."""


@dataclasses.dataclass(frozen=True)
class Shapes:
    r"""Mode shapes over :math:`0 \le \xi \le 1`.

    With the tip mass :math:`\mu` in masses of the beam
    :math:`\int \varphi_i \varphi_j\, d\xi + \mu \varphi_i(1) \varphi_j(1) = \delta_{ij}`. The first
    derivative at the left end that does not vanish is positive.

    Parameters
    ----------
    wavenumbers : (n,) array
        :math:`\lambda` of every mode, 0 for the motions of a rigid body.
    coefficients : (n, 4) array
        a, b, c, d of every mode.
    slopes : (n,) array
        Of the rotation of a rigid body, 0 for the others: it is added as slope times xi.
    """

    wavenumbers: Array
    coefficients: Array
    slopes: Array

    def at(self, positions: ArrayLike, *, derivative: int = 0) -> Array:
        """Shapes or their derivatives by xi, (number of positions, number of modes)."""
        xi = np.atleast_1d(np.asarray(positions, float))
        terms = _terms(xi[:, None], self.wavenumbers, derivative)
        bent = np.einsum("fim,mf->im", terms, self.coefficients) * self.wavenumbers**derivative
        straight = {0: xi, 1: np.ones_like(xi)}.get(derivative, np.zeros_like(xi))
        return bent + np.outer(straight, self.slopes)

    def size(self, derivative: int) -> Array:
        """Largest value that each shape's derivative could take, (n,)."""
        bent = np.abs(self.coefficients).sum(axis=1) * self.wavenumbers**derivative
        return bent + (np.abs(self.slopes) if derivative < 2 else 0.0)


def shapes(boundary: BoundaryName, modes: int, *, tip: float = 0.0) -> Shapes:
    """First modes of a beam, rigid-body motions included.

    Parameters
    ----------
    boundary : BoundaryName
        A name in `BOUNDARIES`.
    modes : int
        Number of modes.
    tip : float
        Mass at the free end of a cantilever in units of the mass of the beam.

    Raises
    ------
    ModelError
        If the number of modes is not a whole number from 1 on, or the tip
        mass is negative or at a beam that is no cantilever.
    """
    if not isinstance(modes, int | np.integer) or modes < 1:
        raise ModelError(f"the number of modes is {modes}; it must be a whole number from 1 on")
    if not (math.isfinite(tip) and tip >= 0):
        raise ModelError(f"the tip mass is {tip:g} masses of the beam; it must not be negative")
    if tip and boundary != "cantilever":
        raise ModelError(f"a tip mass needs a free end: a cantilever, not a {boundary} beam")
    held = BOUNDARIES[boundary]
    rigid = min(held.rigid, modes)
    roots = [_root(held, n, tip) for n in range(modes - rigid)]
    # Translation, and rotation about the middle: 1 and sqrt(3) (1 - 2 xi).
    constants, slopes = [1.0, math.sqrt(3)][:rigid], [0.0, -2 * math.sqrt(3)][:rigid]
    rows = [[c, 0.0, 0.0, 0.0] for c in constants] + [_shape(held, z, tip) for z in roots]
    return Shapes(
        wavenumbers=np.array([0.0] * rigid + roots),
        coefficients=np.array(rows, float),
        slopes=np.array(slopes + [0.0] * len(roots)),
    )


def _root(held: Boundary, n: int, tip: float) -> float:
    low, high = ((held.before + n + k) * math.pi for k in (0, 1))
    root = scipy.optimize.brentq(
        held.characteristic, low, high, args=(tip,), xtol=1e-300, rtol=4 * np.finfo(float).eps
    )
    return float(root)


def _terms(xi: Array, z: Array | float, derivative: int) -> Array:
    """Derivatives of the four functions by lambda xi, stacked along the first axis."""
    turn = derivative * math.pi / 2
    cosine, sine = np.cos(z * xi + turn), np.sin(z * xi + turn)
    return np.stack([cosine, sine, (-1) ** derivative * np.exp(-z * xi), np.exp(z * (xi - 1))])


def _shape(held: Boundary, z: float, tip: float) -> Array:
    """Coefficients (4,) of the normalised shape: what the four conditions at the ends leave."""
    left, right = ([_terms(np.array(end), z, k) for k in range(4)] for end in (0.0, 1.0))
    # The tip mass takes the shear, tip z phi, off the third derivative by z xi.
    shear = right[3] + tip * z * right[0] if 3 in held.right else right[3]
    ends = [*left, *right[:3], shear]
    conditions = np.stack([ends[k] for k in (*held.left, *(4 + k for k in held.right))])
    shape = np.linalg.svd(conditions)[2][-1]
    first = next(k for k in range(4) if k not in held.left)
    s = np.array(right) @ shape
    at_left = np.array(left) @ shape
    square = (s[0] ** 2 + s[2] ** 2) / 4 - s[1] * s[3] / 2 + tip * s[0] ** 2
    square += (3 * s[0] * s[3] - s[1] * s[2]) / (4 * z)
    square -= (3 * at_left[0] * at_left[3] - at_left[1] * at_left[2]) / (4 * z)
    return shape * np.sign(at_left[first]) / math.sqrt(square)
