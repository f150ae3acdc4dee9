"""Noise over a sampling period: closed forms, the plain block exponential, composition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from backsight.discrete.noise import discretise_noise, random_walk
from backsight.errors import ModelError, TuningError


@pytest.mark.parametrize("dt", [1e-4, 1e-2, 1.0])
def test_integrator_chain_in_closed_form(dt: float) -> None:
    # White noise integrated four times: every entry of Q is a power of dt, down to dt**7 / 252.
    n = 4
    Phi, Q = discretise_noise(np.diag(np.ones(n - 1), 1), np.diag([0, 0, 0, 2.0]), dt=dt)
    factorial = np.array([6.0, 2.0, 1.0, 1.0])
    i, j = np.meshgrid(range(n), range(n), indexing="ij")
    power = 2 * n - 1 - i - j
    expected = 2.0 * dt**power / (power * factorial[i] * factorial[j])
    np.testing.assert_allclose(Q, expected, rtol=1e-13)
    np.testing.assert_allclose(Phi[0], [1, dt, dt**2 / 2, dt**3 / 6], rtol=1e-13)


@pytest.mark.parametrize("dt", [1e-6, 0.1, 1.0, 50.0])
def test_first_order_noise_in_closed_form(dt: float) -> None:
    a, q = 3.0, 0.5
    Phi, Q = discretise_noise([[-a]], [[q]], dt=dt)
    np.testing.assert_allclose(Phi, [[np.exp(-a * dt)]], rtol=1e-12)
    np.testing.assert_allclose(Q, [[-q / (2 * a) * np.expm1(-2 * a * dt)]], rtol=1e-13)


def test_equals_the_block_exponential_where_that_is_accurate() -> None:
    rng = np.random.default_rng(0)
    n, dt = 6, 0.3
    A, factor = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    Qc = factor @ factor.T
    block = expm(np.block([[-A, Qc], [np.zeros((n, n)), A.T]]) * dt)
    transition = block[n:, n:].T
    Phi, Q = discretise_noise(A, Qc, dt=dt)
    np.testing.assert_allclose(Phi, transition, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(Q, transition @ block[:n, n:], rtol=1e-11, atol=1e-13)


def test_a_sample_of_the_stage() -> None:
    # From an independent implementation: displacement in 5 um, speed in 1e4 um/s, 0.1 ms.
    A = [[0, 2000], [-3500, -77]]
    Phi, Q = discretise_noise(A, np.diag([4e-6, 1.0]), dt=1e-4)
    np.testing.assert_allclose(
        Phi,
        [[0.9652927254853637, 0.1969157235671168], [-0.3446025162424544, 0.9577114701280297]],
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        Q,
        [
            [1.3076275341525035e-06, 9.693882337036166e-06],
            [9.693882337036166e-06, 9.695512092453259e-05],
        ],
        rtol=1e-12,
    )


@pytest.mark.parametrize(("dt", "rtol"), [(1.0, 1e-7), (3e3, 1e-6)])
def test_strong_damping_does_not_overflow(dt: float, rtol: float) -> None:
    # The speed is stationary with variance q / (2 b), the displacement as first-order noise of the
    # rate k / b. The block exponential overflows here.
    k, b, q = 1e4, 2e6, 3.0
    _, Q = discretise_noise([[0, 1], [-k, -b]], np.diag([0.0, q]), dt=dt)
    assert Q[1, 1] == pytest.approx(q / (2 * b), rel=rtol)
    assert Q[0, 0] == pytest.approx(-q / (2 * b * k) * np.expm1(-2 * k / b * dt), rel=rtol)


@given(st.integers(0, 2**32 - 1), st.floats(1e-4, 3.0))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_covariance_is_semidefinite_and_composes(seed: int, dt: float) -> None:
    rng = np.random.default_rng(seed)
    A, factor = rng.standard_normal((4, 4)), rng.standard_normal((4, 1))
    Qc = factor @ factor.T
    Phi, Q = discretise_noise(A, Qc, dt=dt)
    np.testing.assert_array_equal(Q, Q.T)
    assert np.linalg.eigvalsh(Q)[0] > -1e-14 * np.trace(Q)
    Phi2, Q2 = discretise_noise(A, Qc, dt=2 * dt)
    np.testing.assert_allclose(Phi @ Phi, Phi2, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(Q + Phi @ Q @ Phi.T, Q2, rtol=1e-10, atol=1e-12 * np.trace(Q2))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_units_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, Qc, scale = (
        rng.standard_normal((3, 3)),
        np.diag(rng.random(3)),
        10.0 ** rng.integers(-6, 7, 3),
    )
    _, Q = discretise_noise(A, Qc, dt=0.5)
    _, scaled = discretise_noise(A * scale[:, None] / scale, Qc * np.outer(scale, scale), dt=0.5)
    np.testing.assert_allclose(scaled / np.outer(scale, scale), Q, rtol=1e-10, atol=1e-13)


def test_random_walks_have_the_deviation_asked_for() -> None:
    sigma = np.array([0.01, 0.0, 3e3])
    Phi, Q = discretise_noise(np.zeros((3, 3)), random_walk(sigma, dt=1e-4), dt=1e-4)
    np.testing.assert_array_equal(Phi, np.eye(3))
    np.testing.assert_allclose(Q, np.diag(sigma**2), rtol=1e-14)
    _, four = discretise_noise(np.zeros((3, 3)), random_walk(sigma, dt=1e-4), dt=4e-4)
    np.testing.assert_allclose(np.sqrt(four.diagonal()), 2 * sigma, rtol=1e-14)


def test_density_of_the_stage() -> None:
    # Eq. 41: sigma = 0.01 um per 0.1 ms, scaled by 5 um, is a density of 0.04.
    np.testing.assert_allclose(random_walk(0.01 / 5, dt=1e-4), [[0.04]])


@pytest.mark.parametrize(
    ("A", "Qc", "dt", "error", "reason"),
    [
        (np.zeros((1, 2)), np.eye(1), 1.0, ModelError, "A must be a square matrix"),
        ([[np.inf]], [[1.0]], 1.0, ModelError, "A must be a square matrix of finite"),
        ([[0.0]], [[1.0]], -1.0, ModelError, "sampling period dt is -1.0"),
        (np.eye(2), np.eye(3), 1.0, TuningError, r"Qc must be finite and of the shape \(2, 2\)"),
        (np.eye(2), [[1, np.nan], [np.nan, 1]], 1.0, TuningError, "Qc must be finite"),
        (np.eye(2), [[1, 0.5], [0, 1]], 1.0, TuningError, "Qc is not symmetric"),
        (np.eye(2), [[1, 2], [2, 1]], 1.0, TuningError, "smallest eigenvalue is -1"),
        (np.eye(2), [[1, 0], [0, -1e-9]], 1.0, TuningError, "smallest eigenvalue is -1e-09"),
    ],
)
def test_wrong_arguments_are_refused(A, Qc, dt: float, error: type, reason: str) -> None:
    with pytest.raises(error, match=reason):
        discretise_noise(A, Qc, dt=dt)


@pytest.mark.parametrize("sigma", [-1.0, [1.0, np.nan], [[1.0, 2.0]]])
def test_wrong_deviations_are_refused(sigma: object) -> None:
    with pytest.raises(TuningError, match="one number >= 0 per state"):
        random_walk(sigma, dt=1.0)
