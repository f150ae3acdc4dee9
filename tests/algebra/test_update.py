"""The masked update is the update with the rows left out, also for correlated noise."""

import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from backsight.algebra.update import gain, joseph, masked

seeds = st.integers(0, 2**32 - 1)


def gaussian(n: int, rng: np.random.Generator) -> np.ndarray:
    A = rng.standard_normal((n, n + 1))
    return A @ A.T + 0.05 * np.eye(n)


def value(expression: ca.SX) -> np.ndarray:
    return np.asarray(ca.evalf(ca.densify(expression)))


@given(st.integers(1, 5), st.integers(1, 4), seeds, st.data())
def test_masked_rows_are_deleted_rows(nx, ny, seed, data):
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=ny, max_size=ny)), float)
    rng = np.random.default_rng(seed)
    P, R = gaussian(nx, rng), gaussian(ny, rng)
    H, e = rng.standard_normal((ny, nx)), rng.standard_normal(ny)
    Hm, em, Rm = masked(ca.SX(H), ca.SX(e), ca.SX(R), ca.SX(mask))
    K, _ = gain(ca.SX(P), Hm, Rm)
    shift, P_post = value(K @ em)[:, 0], value(joseph(ca.SX(P), K, Hm, Rm))

    rows = np.flatnonzero(mask)
    H, R, e = H[rows], R[np.ix_(rows, rows)], e[rows]
    if len(rows):
        information = np.linalg.inv(P) + H.T @ np.linalg.solve(R, H)
        expected = np.linalg.inv(information)
        np.testing.assert_allclose(shift, expected @ H.T @ np.linalg.solve(R, e), atol=1e-8)
        np.testing.assert_allclose(P_post, expected, atol=1e-8)
    else:
        np.testing.assert_array_equal(shift, 0.0)
        np.testing.assert_array_equal(P_post, P)


@given(st.integers(1, 5), st.integers(1, 4), seeds)
def test_joseph_is_positive_for_any_gain(nx, ny, seed):
    rng = np.random.default_rng(seed)
    P, R = gaussian(nx, rng), gaussian(ny, rng)
    H, K = rng.standard_normal((ny, nx)), 10 * rng.standard_normal((nx, ny))
    P_post = value(joseph(*(ca.SX(m) for m in (P, K, H, R))))
    np.testing.assert_allclose(P_post, P_post.T, rtol=1e-12, atol=1e-12)
    assert np.linalg.eigvalsh(P_post)[0] >= -1e-12 * np.trace(P_post)
