r"""Exact steps of models that are linear in the states, with coefficients that the inputs change.

With :math:`\dot x = A(u)\,x + b(u)` and the state continued by a one, :math:`z = (x, 1)`, the
motion is :math:`\dot z = M(u)\,z` with :math:`M = [A, b; 0, 0]`: a matrix exponential per sample
where the inputs are held, and a product of them where they are interpolated,

.. math::
    \Omega = \tfrac h2 (M_1 + M_2) + \tfrac{\sqrt 3}{12} h^2 (M_2 M_1 - M_1 M_2), \qquad
    z(t + h) \approx e^{\Omega} z(t),

with M at the two points of Gauss in a sub-step: the method of Magnus of fourth order (the noise is
that of the mean matrix, to second order). Source: Blanes, Casas, Oteo, Ros, "The Magnus expansion
and some of its applications", 2009, section 5, doi:10.1016/j.physrep.2008.11.001.

The exponential is a series on a fraction of the period and doublings, as many as this sample's
matrix needs, and so is the noise, see `backsight.discrete.noise`.
"""

import dataclasses

import casadi as ca
import numpy as np
import scipy

from backsight.discrete.exact import zoh
from backsight.discrete.noise import discretise_noise
from backsight.engine.dense import UNROLL, add_product, transpose
from backsight.engine.loops import iterate, scan
from backsight.models.lti import coefficients
from backsight.models.model import Model
from backsight.types import Array

TERMS = 18
"""Of the series, which is for matrices of a norm of at most 1/2: the next is below 1e-21."""

DOUBLINGS = 60
"""At most; what needs more is not a number of this world."""

PIECES = 8
"""Sub-steps of a sampling period in which inputs are interpolated. An angle that turns by 0.6 rad
per sample then costs 1e-8 of what it moves."""


def transitions(model: Model, Qc: Array, *, dt: float, ramp: bool) -> ca.Function:
    """``(u, u_next) -> (A, b, Q)``: the next state is A x + b, and Q the covariance of its noise.

    Parameters
    ----------
    model : Model
        Linear in its states, see `backsight.models.lti.bent`.
    Qc : (nx, nx) array
        Spectral density of its noise; zero for a discrete-time model.
    dt : float
        Sampling period [s].
    ramp : bool
        Whether inputs are interpolated between the samples; else they are held.
    """
    nx, nu = model.nx, model.nu
    u, v = ca.MX.sym("u", nu), ca.MX.sym("u_next", nu)
    A, b = coefficients(model)(u)
    Q: ca.MX = ca.MX(ca.DM.zeros(nx, nx).full())
    if not model.continuous:
        return ca.Function("transitions", [u, v], [A, b, Q])
    fixed = constant_part(model)
    if fixed is not None and not ramp:
        Phi, response = zoh(fixed, np.eye(nx), dt=dt)
        Q = ca.MX(ca.DM(discretise_noise(fixed, Qc, dt=dt)[1]))
        return ca.Function("transitions", [u, v], [ca.MX(ca.DM(Phi)), _times(response, b), Q])
    grid = _Balanced(model, Qc)
    n, noisy = nx + 1, bool(Qc.any())
    start = [ca.MX(ca.DM(np.eye(n)))] + ([ca.MX(ca.DM(np.zeros((n, n))))] if noisy else [])
    if ramp:
        xs = _pieces(nu)(u, v)
        found, _ = scan(_piece(grid, dt / PIECES, noisy), PIECES, carry=start, xs=list(xs))
    else:
        found = _exponential(n, noisy)(grid.generator()(u) * dt, ca.MX(ca.DM(grid.density * dt)))
        found = list(found) if noisy else [found]
    end = grid.in_units(noisy).call(found)
    return ca.Function("transitions", [u, v], [*end, *([] if noisy else [Q])])


def constant_part(model: Model) -> Array | None:
    """A (nx, nx) of a model in which only b depends on the inputs, else None."""
    u = ca.SX.sym("u", model.nu)
    A = coefficients(model)(u)[0]
    return None if ca.depends_on(A, u) else np.asarray(ca.evalf(ca.densify(A)))


@dataclasses.dataclass(frozen=True)
class _Balanced:
    """The continued system in units in which its rows and columns are of one size."""

    model: Model
    Qc: Array

    @property
    def sizes(self) -> Array:
        """Unit of every state in that of the model, (nx + 1,)."""
        n, nu = self.model.nx + 1, self.model.nu
        told = np.zeros((n, n))
        for u in np.vstack([np.zeros(nu), np.eye(nu), -np.eye(nu), 0.3 * np.ones(nu)]):
            A, b = (np.asarray(k) for k in coefficients(self.model)(u))
            here = np.abs(np.hstack([A, b.reshape(-1, 1)]))
            told[:-1] += np.where(np.isfinite(here), here, 0.0)
        _, (scale, _) = scipy.linalg.matrix_balance(told, permute=False, separate=True)
        return np.asarray(scale / scale[-1], float)

    @property
    def density(self) -> Array:
        """Spectral density of the continued state."""
        whole = np.zeros((len(self.Qc) + 1, len(self.Qc) + 1))
        whole[:-1, :-1] = self.Qc
        return whole / np.outer(self.sizes, self.sizes)

    def generator(self) -> ca.Function:
        """``u -> M``."""
        u, d = ca.SX.sym("u", self.model.nu), self.sizes
        A, b = coefficients(self.model)(u)
        M = ca.vertcat(ca.horzcat(A, b), ca.SX.zeros(1, len(d)))
        return ca.Function("generator", [u], [ca.densify(M * (d[None, :] / d[:, None]))])

    def in_units(self, noisy: bool) -> ca.Function:
        """``(E, V) -> (A, b, Q)``, or without V and Q."""
        d, n = self.sizes, len(self.sizes)
        E, V = ca.SX.sym("E", n, n), ca.SX.sym("V", n, n)
        moved = E * (d[:, None] / d[None, :])
        results = [ca.densify(moved[:-1, :-1]), ca.densify(moved[:-1, -1])]
        if not noisy:
            return ca.Function("moved_in_units", [E], results)
        noise = ca.densify((V * np.outer(d, d))[:-1, :-1])
        return ca.Function("moved_in_units", [E, V], [*results, (noise + noise.T) / 2])


def _pieces(nu: int) -> ca.Function:
    """``(u, v) -> (U1, U2)``: inputs at both points of Gauss of every sub-step, side by side."""
    u, v = ca.SX.sym("u", nu), ca.SX.sym("v", nu)
    points = [(0.5 + side * np.sqrt(3) / 6) for side in (-1, 1)]
    columns = [
        ca.horzcat(*(u + (k + at) / PIECES * (v - u) for k in range(PIECES))) for at in points
    ]
    return ca.Function("pieces", [u, v], [ca.densify(c) for c in columns])


def _piece(grid: _Balanced, h: float, noisy: bool) -> ca.Function:
    """One sub-step with interpolated inputs: ``(E, V, u1, u2) -> (E, V)``."""
    nu, n = grid.model.nu, grid.model.nx + 1
    u1, u2 = ca.MX.sym("u1", nu), ca.MX.sym("u2", nu)
    kept = [ca.MX.sym(k, n, n) for k in ("E", "V")[: 1 + noisy]]
    M1, M2 = grid.generator()(u1), grid.generator()(u2)
    turned = _product(M2, M1) - _product(M1, M2)
    Omega = h / 2 * (M1 + M2) + np.sqrt(3) / 12 * h**2 * turned
    found = _exponential(n, noisy)(Omega, ca.MX(ca.DM(grid.density * h)))
    found = list(found) if noisy else [found]
    after = [_product(found[0], kept[0])]
    if noisy:
        after.append(_congruence(found[0], kept[1]) + found[1])
    return ca.Function("piece", [*kept, u1, u2], after)


def _exponential(n: int, noisy: bool) -> ca.Function:
    r"""``(M, W) -> (E, V)``: :math:`e^M` and :math:`\int_0^1 e^{M s} W e^{M' s} ds`."""
    M, W = ca.MX.sym("M", n, n), ca.MX.sym("W", n, n)
    times, small, noise = _fraction(n)(M, W)
    one = ca.MX(ca.DM(np.eye(n)))
    shares = ca.DM([[1 / k for k in range(TERMS, 0, -1)]])
    (E,), _ = scan(_horner(n), TERMS, carry=[one], xs=[ca.MX(shares)], constants=[small])
    carry = [times, E]
    if noisy:
        shares = ca.DM([[1 / k for k in range(2, TERMS + 2)]])
        (_, V), _ = scan(
            _series(n), TERMS, carry=[noise, noise], xs=[ca.MX(shares)], constants=[small]
        )
        carry.append(V)
    found = iterate(_doubled(n, noisy), DOUBLINGS, carry=carry)
    return ca.Function("exponential", [M, W], found[1:])


def _fraction(n: int) -> ca.Function:
    """``(M, W) -> (times, M, W)``: both halved so many times that the norm of M is at most 1/2."""
    M, W = ca.SX.sym("M", n, n), ca.SX.sym("W", n, n)
    norm = ca.mmax(ca.sum1(ca.fabs(M)))
    times = ca.ceil(ca.log(2 * ca.fmax(norm, 0.5)) / np.log(2))
    share = ca.exp(-np.log(2) * times)
    return ca.Function("fraction", [M, W], [times, share * M, share * W])


def _horner(n: int) -> ca.Function:
    """``(E, 1/k, M) -> I + M E / k``."""
    E, share, M = ca.MX.sym("E", n, n), ca.MX.sym("share"), ca.MX.sym("M", n, n)
    return ca.Function("horner", [E, share, M], [ca.MX(ca.DM(np.eye(n))) + share * _product(M, E)])


def _series(n: int) -> ca.Function:
    """``(term, V, 1/k, M) -> (term, V)``: the next term (M term + term M') / k and the sum."""
    term, V = ca.MX.sym("term", n, n), ca.MX.sym("V", n, n)
    share, M = ca.MX.sym("share"), ca.MX.sym("M", n, n)
    moved = _product(M, term)
    after = share * (moved + transpose(moved))
    return ca.Function("series", [term, V, share, M], [after, V + after])


def _doubled(n: int, noisy: bool) -> ca.Function:
    """Twice the time: ``(times, E, V) -> (times - 1, E E, E V E' + V)``."""
    times, E, V = ca.MX.sym("times"), ca.MX.sym("E", n, n), ca.MX.sym("V", n, n)
    results = [times - 1, _product(E, E), *([V + _congruence(E, V)] if noisy else [])]
    return ca.Function("doubled", [times, E, V][: 2 + noisy], results)


def _congruence(E: ca.MX, V: ca.MX) -> ca.MX:
    """E V E' of a symmetric V."""
    return _product(_product(E, V), transpose(E))


def _product(A: ca.MX, B: ca.MX) -> ca.MX:
    """A B of dense matrices."""
    if A.shape[0] > UNROLL:
        return add_product(ca.MX.zeros(A.shape[0], B.shape[1]), A, transpose(B))
    a, b = ca.SX.sym("A", *A.shape), ca.SX.sym("B", *B.shape)
    return ca.Function(f"product_{A.shape[0]}", [a, b], [ca.densify(a @ b)])(A, B)


def _times(matrix: Array, vector: ca.MX) -> ca.MX:
    v = ca.SX.sym("v", vector.numel())
    product = ca.densify(ca.sparsify(ca.DM(matrix)) @ v)
    return ca.Function("response", [v], [product])(vector)
