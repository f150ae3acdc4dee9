"""Factorisations on expressions against NumPy, on random matrices of every size that occurs."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backsight.algebra.factor import cholesky_semidefinite, ldl, solve_spd

sizes = st.integers(1, 8)
seeds = st.integers(0, 2**32 - 1)


def spd(n: int, seed: int) -> np.ndarray:
    """Random positive definite matrix with rows of very different sizes."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n + 2))
    size = 10.0 ** rng.uniform(-3, 3, n)
    return (A @ A.T + 0.1 * np.eye(n)) * np.outer(size, size)


def value(expression: ca.SX) -> np.ndarray:
    return np.asarray(ca.evalf(ca.densify(expression)))


@given(sizes, st.integers(1, 3), seeds)
def test_solve(n, columns, seed):
    A, B = spd(n, seed), np.random.default_rng(seed + 1).standard_normal((n, columns))
    X = value(solve_spd(ca.SX(A), ca.SX(B)))
    size = np.sqrt(np.diag(A))
    expected = np.linalg.solve(A / np.outer(size, size), B / size[:, None]) / size[:, None]
    np.testing.assert_allclose(X, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


@given(sizes, seeds)
def test_ldl(n, seed):
    A = spd(n, seed)
    L, d = map(value, ldl(ca.SX(A)))
    np.testing.assert_array_equal(L, np.tril(L))
    np.testing.assert_array_equal(np.diag(L), 1.0)
    root = np.linalg.cholesky(A)
    np.testing.assert_allclose(L * np.sqrt(d[:, 0]), root, rtol=1e-8, atol=1e-12)


@given(sizes, seeds)
def test_cholesky_of_a_definite_matrix(n, seed):
    A = spd(n, seed)
    np.testing.assert_allclose(
        value(cholesky_semidefinite(ca.SX(A))), np.linalg.cholesky(A), rtol=1e-8, atol=1e-12
    )


@given(st.integers(2, 8), seeds, st.data())
def test_cholesky_of_a_semidefinite_matrix(n, seed, data):
    """Rank and the product L L' are right, and every rank below n gives zero columns."""
    rank = data.draw(st.integers(0, n - 1))
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((n, rank))
    A = F @ F.T
    L = value(cholesky_semidefinite(ca.SX(A)))
    np.testing.assert_array_equal(L, np.tril(L))
    assert np.all(np.isfinite(L))
    np.testing.assert_allclose(L @ L.T, A, atol=1e-6 * (1 + np.abs(A).max()))


def test_cholesky_of_known_states():
    """A state without any variance: its row and column are zero, the others as before."""
    P = np.diag([4.0, 0.0, 9.0])
    P[0, 2] = P[2, 0] = 3.0
    L = value(cholesky_semidefinite(ca.SX(P)))
    np.testing.assert_array_equal(L[1], 0.0)
    np.testing.assert_array_equal(L[:, 1], 0.0)
    np.testing.assert_allclose(L @ L.T, P, rtol=1e-15)


@pytest.mark.parametrize("tiny", [1e-200, 1e-30, 1e30])
def test_size_does_not_matter(tiny):
    """No absolute threshold anywhere: a covariance of any unit is factored the same way."""
    A = spd(4, 7)
    one, other = (value(cholesky_semidefinite(ca.SX(s * A))) for s in (1.0, tiny))
    np.testing.assert_allclose(other / np.sqrt(tiny), one, rtol=1e-12)
