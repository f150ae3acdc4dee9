"""Rigid bodies are recognised by the rounding of their own mode, whatever the rest is."""

import numpy as np
import pytest
import scipy.sparse as sparse
from tests.models.finite_elements import CANTILEVER_HZ, FREE_HZ, beam_matrices, two

from backsight.errors import BacksightWarning, ModelError
from backsight.models.lti import state_space
from backsight.models.structures import reduced
from backsight.models.structures.matrices.lowest_modes import lowest


def hertz(M, K, modes, **changes):
    """Frequencies that the model keeps."""
    given = {"damping": 0.01, "sensors": {"y": ("displacement", len(M) - 2)}} | changes
    A = state_space(reduced(M, K, modes=modes, **given))[0]
    return np.sqrt(-np.diag(A[modes:, :modes])) / (2 * np.pi)


@pytest.mark.parametrize("n", [10, 74, 150, 400])
def test_cantilevers_of_any_fineness_bend(n):
    np.testing.assert_allclose(hertz(*beam_matrices(n), 3), CANTILEVER_HZ, rtol=4e-4)


@pytest.mark.parametrize("n", [10, 74, 400])
def test_free_beams_move_as_rigid_bodies(n):
    found = hertz(*beam_matrices(n, free=True), 4)
    assert not found[:2].any()
    np.testing.assert_allclose(found[2:], FREE_HZ, rtol=4e-4)


def test_rotations_in_another_unit():
    """Degrees of a thousand sizes: a congruence changes no frequency."""
    M, K = beam_matrices(40, free=True)
    units = 10.0 ** np.random.default_rng(1).uniform(-6, 6, len(M))
    found = hertz(units[:, None] * M * units, units[:, None] * K * units, 4)
    assert not found[:2].any()
    np.testing.assert_allclose(found[2:], FREE_HZ, rtol=1e-4)


def test_two_bodies_on_the_softest_spring():
    """Two free steel beams, tip to tip by 1 mN/m: only the mode of the spring is no rigid body."""
    M, K = beam_matrices(30, free=True)
    n = len(M)
    M, K = two(M, M), two(K, K)
    k = 1e-3
    at = np.zeros(2 * n)
    at[n - 2], at[n] = 1, -1
    found = hertz(M, K + k * np.outer(at, at), 5)
    assert not found[:3].any()
    # A free beam has a quarter of its mass at its tip.
    mass = 7850 * 0.02 * 0.005
    assert found[3] == pytest.approx(np.sqrt(k / (mass / 8)) / (2 * np.pi), rel=1e-3)


def test_a_light_stiff_coordinate_beside_a_heavy_soft_one():
    M, K = np.diag([1e-6, 1.0]), np.array([[1e6 + 10, -10.0], [-10.0, 10.0]])
    exact = np.sqrt(10 - 100 / (1e6 + 10)) / (2 * np.pi)
    assert hertz(M, K, 1, sensors={"y": ("displacement", 1)})[0] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("penalty", [1e3, 1e6, 1e9])
def test_a_penalty_holds(penalty):
    M, K = beam_matrices(10, free=True)
    for i in (0, 1):
        K[i, i] += penalty * K.max()
    np.testing.assert_allclose(hertz(M, K, 3), CANTILEVER_HZ, rtol=1e-3)


def test_a_mechanism_has_one_more():
    """Two beams on a hinge, which equals the deflections only."""
    M, K = beam_matrices(20, free=True)
    n = len(M)
    hinge = [{n - 2: 1.0, n: -1.0}]
    found = hertz(two(M, M), two(K, K), 4, constraints=hinge)
    assert not found[:3].any()
    assert found[3] > 1


@pytest.mark.parametrize("n", [10, 74])
def test_slightly_indefinite_is_refused(n):
    """The lowest square below zero by 1 % of what it was; just above zero is a frequency."""
    M, K = beam_matrices(n)
    square = (2 * np.pi * hertz(M, K, 1)[0]) ** 2
    message = "stiffness is not positive semidefinite: a squared frequency is -6.8"
    with pytest.raises(ModelError, match=message):
        hertz(M, K - 1.01 * square * M, 2)
    held = hertz(M, K - 0.9999 * square * M, 2)
    assert held[0] == pytest.approx(0.01 * CANTILEVER_HZ[0], rel=1e-3)


@pytest.mark.parametrize("least", [-5e6, -50.0, -1e-9])
@pytest.mark.parametrize("n", [5, 900])
def test_one_negative_eigenvalue_anywhere_is_found(least, n):
    K = sparse.diags_array(np.append(np.arange(1.0, n), least)).tocsc()
    M = sparse.identity(n, format="csc")
    with pytest.raises(ModelError, match="stiffness is not positive semidefinite"):
        reduced(M, K, modes=2, damping=0.1, sensors={"y": ("displacement", 0)})


def test_single_precision_says_what_it_cannot_tell():
    free = beam_matrices(20, free=True)
    found = hertz(free[0], free[1].astype(np.float32), 4)
    assert not found[:2].any()
    M, K = beam_matrices(20)
    with pytest.warns(BacksightWarning, match=r"modes at 4\.18 Hz may be wrong by 2 %"):
        np.testing.assert_allclose(hertz(M, K.astype(np.float32), 3), CANTILEVER_HZ, rtol=1e-3)
    M, K = beam_matrices(74)
    with pytest.warns(BacksightWarning, match="taken for rigid bodies"):
        assert hertz(M, K.astype(np.float32), 1)[0] == 0


def test_many_modes_of_one_frequency_are_all_found():
    """Fifty free beams in one matrix: 100 rigid bodies, of which Lanczos alone finds 84."""
    beams = sparse.eye_array(50)
    M, K = (sparse.csc_array(sparse.kron(beams, A)) for A in beam_matrices(6, free=True))
    found = lowest(M, K, 105, precision=1e-16)
    assert not found.squares[:100].any()
    hertz_of = np.sqrt(found.squares[100:]) / (2 * np.pi)
    np.testing.assert_allclose(hertz_of, FREE_HZ[0], rtol=1e-3)
    np.testing.assert_allclose(found.shapes.T @ (M @ found.shapes), np.eye(105), atol=1e-9)


def test_frequencies_that_lie_close_together_are_all_found():
    """A ring of equal masses on springs that hardly know each other."""
    n = 700
    ring = sparse.eye_array(n, k=1) + sparse.eye_array(n, k=1 - n)
    K = sparse.csc_array(1.0002 * sparse.eye_array(n) - 1e-4 * (ring + ring.T))
    found = lowest(sparse.csc_array(sparse.eye_array(n)), K, 9, precision=1e-16)
    exact = np.sort(1.0002 - 2e-4 * np.cos(2 * np.pi * np.arange(n) / n))[:9]
    np.testing.assert_allclose(found.squares, exact, rtol=1e-12)
