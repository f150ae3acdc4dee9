r"""Complex modes of a structure whose matrices are not symmetric, in real blocks.

The dynamic stiffness :math:`Q(s) = M s^2 + C s + K` has right and left modes,
:math:`Q(\lambda) \varphi = 0` and :math:`\psi' Q(\lambda) = 0`, and its inverse is the sum

.. math::
    Q(s)^{-1} = \sum_i \frac{\varphi_i \psi_i'}{a_i (s - \lambda_i)}, \qquad
    a_i = \psi_i' (2 \lambda_i M + C) \varphi_i \qquad (1)

so that :math:`\dot s_i = \lambda_i s_i + \psi_i' f / a_i` and
:math:`w = \sum_i \varphi_i s_i`. Pairs of conjugate modes become real blocks
:math:`[[\alpha, -\omega], [\omega, \alpha]]` of :math:`2 \mathrm{Re}\, s, 2 \mathrm{Im}\, s`.

Source: Lancaster, "Lambda-Matrices and Vibrating Systems", 1966, section 4.4; Lee, "Vibration
Analysis of Rotors", 1993, section 2.3.
"""

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from backsight.errors import BacksightWarning, ModelError
from backsight.types import Array, Complex, Indices, Sparse

DENSE = 300
"""Up to so many coordinates all modes are computed."""

_DEFECTIVE = 1e-7
"""Left and right modes that are nearly orthogonal belong to no mode of their own."""

_REAL = 1e-10
"""Share of an imaginary part that is rounding."""


@dataclasses.dataclass(frozen=True)
class ComplexModes:
    r"""Modes with the imaginary part of :math:`\lambda` not negative; the others are conjugate.

    Parameters
    ----------
    values : (m,) complex array
        :math:`\lambda` [rad/s], by magnitude.
    right : (n, m) complex array
        :math:`\varphi`, scaled to :math:`\varphi^H M \varphi = 1`, as real as can be.
    left : (n, m) complex array
        :math:`\psi / a`.
    """

    values: Complex
    right: Complex
    left: Complex

    @property
    def paired(self) -> Indices:
        """Which modes stand for two, (m,)."""
        return self.values.imag > 0

    def damped(self, ratios: Array) -> "ComplexModes":
        r"""With more damping: ratios to critical in addition, frequencies as they are.

        The first of the ratios are for the pairs, in their order. With real modes this is
        :math:`\ddot q + 2 \zeta \omega \dot q + \omega^2 q`, a of (1) follows the frequency.
        """
        pairs = self.values[self.paired]
        size = np.abs(pairs)
        zeta = -pairs.real / size + ratios[: pairs.size]
        if (np.abs(zeta) >= 1).any():
            raise ModelError("a damping ratio together with the damping matrix is 1 or more")
        values = self.values.copy()
        values[self.paired] = size * (-zeta + 1j * np.sqrt(1 - zeta**2))
        left = self.left.copy()
        left[:, self.paired] *= pairs.imag / values[self.paired].imag
        return dataclasses.replace(self, values=values, left=left)

    def blocks(self) -> tuple[Array, Array, Array]:
        """Matrix of the states (k, k), what takes them to w (n, k), and forces to them (k, n)."""
        S, out, into = [], [], []
        for value, phi, psi, pair in zip(
            self.values, self.right.T, self.left.T, self.paired, strict=True
        ):
            if pair:
                S.append([[value.real, -value.imag], [value.imag, value.real]])
                out += [phi.real, -phi.imag]
                into += [2 * psi.real, 2 * psi.imag]
            else:
                S.append([[value.real]])
                out.append(phi.real)
                into.append(psi.real)
        return scipy.linalg.block_diag(*S), np.array(out).T, np.array(into)


def complex_modes(M: Sparse, C: Sparse, K: Sparse, count: int) -> ComplexModes:
    """Find the modes of the smallest eigenvalues, together 2 `count` states.

    Raises
    ------
    ModelError
        If the stiffness is singular (the structure is free), or two modes coincide so that they do
        not separate.
    """
    values, right = _right_modes(M, C, K, count)
    _, left = _right_modes(M.T, C.T, K.T, count, near=values)
    # (1) for all pairs of modes: of distinct ones G is zero, of repeated ones a block.
    G = left.T @ (M @ right) * (values[:, None] + values) + left.T @ (C @ right)
    size = np.linalg.svd(G / np.sqrt(np.outer(_rows(G), _rows(G.T))), compute_uv=False)
    if size[-1] < _DEFECTIVE:
        raise ModelError(
            "two complex modes coincide and do not separate (a free structure, or a double "
            "eigenvalue with one shape); hold the structure, or change the number of modes"
        )
    left = np.linalg.solve(G, left.T).T.astype(complex)
    upper = values.imag >= 0
    found = ComplexModes(values[upper], right[:, upper], left[:, upper])
    _warn_of_growth(found)
    return found


def _rows(G: Array) -> Array:
    return np.linalg.norm(G, axis=1)


def _right_modes(
    M: Sparse,
    C: Sparse,
    K: Sparse,
    count: int,
    *,
    near: Complex | None = None,
) -> tuple[Complex, Complex]:
    """Eigenvalues and right modes: theta = 1 / lambda of [[-K^-1 C, -K^-1 M], [I, 0]].

    Those of the smallest magnitude in whole pairs; or those that are nearest to given ones.
    """
    n = M.shape[0]
    try:
        factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(K))
    except RuntimeError:
        raise ModelError(
            "stiffness is singular: a free structure whose matrices are not symmetric has no "
            "separate modes; hold it by its supports"
        ) from None
    if n <= DENSE or 4 * count + 20 >= n:
        flexibility = factor.solve(np.eye(n))
        top = np.hstack([-flexibility @ C.toarray(), -flexibility @ M.toarray()])
        theta, X = np.linalg.eig(np.vstack([top, np.eye(n, 2 * n)]))
    else:
        speed = _speed(M, factor.solve)

        def apply(z: Array) -> Array:
            x, v = z[:n], z[n:] * speed
            return np.concatenate([-factor.solve(C @ x + M @ v), x / speed])

        operator = scipy.sparse.linalg.LinearOperator((2 * n, 2 * n), apply, dtype=float)
        start = np.random.default_rng(0).standard_normal(2 * n)
        found: Any = scipy.sparse.linalg.eigs(operator, 2 * count + 4, v0=start, ncv=4 * count + 20)
        theta, X = found
    theta = theta.astype(complex)
    moving = np.abs(theta) > np.finfo(float).eps * np.abs(theta).max()
    values: Any = 1 / theta[moving]
    shapes = X[:n, moving]
    kept = _lowest_pairs(values, 2 * count) if near is None else _nearest(values, near)
    values, shapes = values[kept], shapes[:, kept]
    values = np.where(np.abs(values.imag) < _REAL * np.abs(values), values.real, values)
    # As real as can be: the sum of squares is real.
    turn = np.exp(-0.5j * np.angle((shapes**2).sum(axis=0)))
    shapes = shapes * turn
    scale = np.sqrt(np.abs(np.einsum("ij,ij->j", shapes.conj(), M @ shapes)))
    return values, shapes / scale


def _speed(M: Sparse, solve: Callable[[Array], Array]) -> float:
    """About the lowest frequency: it makes rates as large as deflections."""
    x = np.random.default_rng(0).standard_normal(M.shape[0])
    theta = 1.0
    for _ in range(8):
        x = solve(M @ (x / np.linalg.norm(x)))
        theta = float(np.linalg.norm(x))
    return theta**-0.5


def _lowest_pairs(values: Complex, states: int) -> Indices:
    """Numbers of the smallest eigenvalues, pairs whole, in pairs by magnitude."""
    order = sorted(range(len(values)), key=lambda i: (round(abs(values[i]), 9), -values[i].imag))
    kept: list[int] = []
    for i in order:
        real = abs(values[i].imag) < _REAL * abs(values[i])
        if values[i].imag < 0 and not real:
            continue
        if len(kept) + (1 if real else 2) > states:
            break
        kept.append(i)
        if not real:
            kept.append(int(np.argmin(np.abs(values - values[i].conj()))))
    return np.array(kept, int)


def _nearest(values: Complex, wanted: Complex) -> Indices:
    """One number for each wanted value, each taken once."""
    left, kept = list(range(len(values))), []
    for value in wanted:
        i = min(left, key=lambda k: abs(values[k] - value))
        left.remove(i)
        kept.append(i)
    return np.array(kept, int)


def _warn_of_growth(found: ComplexModes) -> None:
    growing = found.values[found.values.real > 1e-9 * np.abs(found.values)]
    if growing.size:
        hertz = ", ".join(f"{abs(v) / (2 * np.pi):.4g}" for v in growing)
        warnings.warn(
            f"the structure is not stable: its modes at {hertz} Hz grow",
            BacksightWarning,
            stacklevel=3,
        )
