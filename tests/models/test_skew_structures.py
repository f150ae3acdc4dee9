"""Rotors, towers and whatever is not symmetric: complex modes answer as the whole does."""

import numpy as np
import pytest
from tests.models.finite_elements import at, beam_matrices, frequencies, response, two

from backsight.errors import BacksightWarning, ModelError
from backsight.models.lti import state_space
from backsight.models.structures import reduced


def rotor(cross, elements=6, speed=200.0):
    """Shaft with a disc between two bearings, in two planes: gyroscopic, cross-coupled."""
    M1, K1 = beam_matrices(elements, free=True, b=0.026, h=0.026)
    n = len(M1)
    M, K, G = two(M1, M1), two(K1, K1), np.zeros((2 * n, 2 * n))
    i = 2 * (elements // 2)
    for offset in (0, n):
        M[offset + i, offset + i] += 8.0
        M[offset + i + 1, offset + i + 1] += 0.02
    G[i + 1, n + i + 1], G[n + i + 1, i + 1] = 0.04, -0.04
    C = 2e-5 * K
    for node in (1, elements - 1):
        j = 2 * node
        for k in (j, n + j):
            K[k, k] += 5e6
            C[k, k] += 2e3
        K[j, n + j] += cross
        K[n + j, j] -= cross
    return M, C + speed * G, K


@pytest.mark.parametrize("cross", [0.0, 2e5])
def test_rotors_by_all_complex_modes_are_exact(cross):
    M, C, K = rotor(cross)
    n = len(M)
    kinds = ("displacement", "velocity", "acceleration")
    with pytest.warns(BacksightWarning, match="not symmetric: .*Complex modes are kept"):
        found = reduced(
            M, K, modes=n, damping_matrix=C,
            sensors={kind[0]: (kind, 2) for kind in kinds}, inputs={"F": 6, "G": n // 2 + 6},
        )  # fmt: skip
    for s in (0, 40j, 200j, 700j):
        exact = response(M, C, K, s)[2, [6, n // 2 + 6]]
        got = at(found, s)
        np.testing.assert_allclose(got[0], exact, rtol=1e-6, atol=1e-9 * np.abs(exact).max())
        for row, factor in ((1, s), (2, s * s)):
            scale = max(np.abs(factor * exact).max(), 1e-4)
            np.testing.assert_allclose(got[row], factor * exact, atol=1e-5 * scale)


def test_large_rotors_by_shift_and_invert():
    """404 coordinates: the sparse solver for complex modes."""
    M, C, K = rotor(2e5, elements=100)
    given = {"sensors": {"x": ("displacement", 2)}, "inputs": {"F": 100}, "modes": 4}
    with pytest.warns(BacksightWarning, match="not symmetric"):
        found = reduced(M, K, damping_matrix=C, residual="feedthrough", **given)
    for s, close in ((0, 1e-6), (200j, 2e-2)):
        exact = response(M, C, K, s)[2, 100]
        assert at(found, s).item() == pytest.approx(exact, rel=close)


def test_a_tower_of_45_storeys_with_a_skew_part_of_the_stiffness():
    """A flexibility whose mirrored entries differ by 2 %: the roof under wind, in one line."""
    n = 45
    k = np.linspace(3e9, 6e8, n)
    K = np.diag(k + np.append(k[1:], 0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    upper = np.triu(np.ones((n, n)), 1)
    K = np.linalg.inv(np.linalg.inv(K) * (1 + 0.01 * (upper - upper.T)))
    wind = np.linspace(0.5, 1, n)
    wind *= 0.119 / np.linalg.solve(K, wind)[-1]
    tower = {"modes": 5, "damping": 0.01, "sensors": {"roof": ("displacement", n - 1)}}
    with pytest.warns(BacksightWarning, match="stiffness is not symmetric: .* skew part is 19 %"):
        model = reduced(np.full(n, 2.2e6), K, inputs={"wind": wind}, **tower)
    assert at(model, 0).item() == pytest.approx(0.119, abs=3e-4)
    squares = np.sort(np.linalg.eigvals(K).real)[:5] / 2.2e6
    np.testing.assert_allclose(frequencies(model), np.sqrt(squares) / (2 * np.pi), rtol=1e-9)
    poles = np.linalg.eigvals(state_space(model)[0])
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.01, rtol=1e-6)
    symmetric = np.linalg.solve((K + K.T) / 2, wind)[-1]
    assert abs(symmetric - 0.119) > 3e-4  # what making it symmetric would do


@pytest.mark.filterwarnings("ignore:.*is not symmetric")
def test_growing_modes_are_said():
    M, C, K = rotor(2e6)
    with pytest.warns(BacksightWarning, match=r"the structure is not stable: its modes at"):
        reduced(M, K, modes=4, damping_matrix=C, sensors={"x": ("displacement", 2)})


@pytest.mark.filterwarnings("ignore:stiffness is not symmetric")
def test_a_free_skew_structure_is_refused():
    K = np.array([[1.0, -1.0], [-2.0, 2.0]])
    with pytest.raises(ModelError, match="free structure whose matrices are not symmetric"):
        reduced(np.eye(2), K, modes=1, damping=0.1, sensors={"y": ("displacement", 0)})
