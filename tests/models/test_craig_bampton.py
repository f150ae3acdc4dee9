"""Substructures: exact at rest, exact with all modes, and two of them joined are the whole."""

import numpy as np
import pytest
import scipy
from tests.models.finite_elements import at, beam_matrices, response

from backsight.errors import ModelError
from backsight.models.structures import craig_bampton, second_order


@pytest.mark.parametrize("modes", [0, 5, 15])
def test_a_spring_at_the_boundary(modes):
    """Its stiffness is a parameter; at rest the answer is that of all coordinates."""
    M, K = beam_matrices(8)
    names = [f"{i // 2 + 1}:{'RZ' if i % 2 else 'UY'}" for i in range(16)]
    part = craig_bampton(
        M, K, boundary=["8:UY"], modes=modes, rayleigh=(0.2, 1e-5), coordinates=names
    )
    stiffness = part.stiffness.astype(object)
    stiffness[0, 0] = f"{stiffness[0, 0]!r} + k"
    found = second_order(
        part.mass, part.damping, stiffness, forces={"F": part.at("8:UY")}, inputs={"F": "N"},
        outputs={"y": ("displacement", part.at("4:UY"))}, parameters={"k": 3e3},
        coordinates=dict.fromkeys(part.coordinates, "m"),
    )  # fmt: skip
    spring = np.zeros_like(K)
    spring[14, 14] = 3e3
    C = 0.2 * M + 1e-5 * K
    for s, close in ((0, 1e-7), (30j, {0: 0.15, 5: 1e-4, 15: 1e-7}[modes])):
        exact = response(M, C, K + spring, s)[6, 14]
        assert at(found, s).item() == pytest.approx(exact, rel=close)


def test_two_halves_make_the_whole():
    M, K = beam_matrices(10, length=0.5, free=True)
    left = craig_bampton(M, K, boundary=[20, 21], modes=4, fixed=[0, 1])
    right = craig_bampton(M, K, boundary=[0, 1], modes=4)
    mass, stiffness = np.zeros((10, 10)), np.zeros((10, 10))
    for part, where in ((left, [0, 1, 2, 3, 4, 5]), (right, [0, 1, 6, 7, 8, 9])):
        mass[np.ix_(where, where)] += part.mass
        stiffness[np.ix_(where, where)] += part.stiffness
    M, K = beam_matrices(20)
    whole, found = (scipy.linalg.eigh(k, m)[0][:4] for m, k in ((M, K), (mass, stiffness)))
    np.testing.assert_allclose(found, whole, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"boundary": [0]}, "the boundary coordinate 0 is fixed"),
        ({"boundary": []}, "the boundary needs at least one coordinate"),
        ({"boundary": [3, 3]}, "each named once"),
        ({"fixed": (), "boundary": [4]}, "the interior can move while the boundary is fixed"),
        ({"modes": 40}, "modes is 40; inside there are 7"),
        ({"stiffness": np.eye(10) + np.eye(10, k=1) + 0.5 * np.eye(10, k=-1)}, "need symmetric"),
    ],
)
def test_what_cannot_be_is_said(changes, message):
    M, K = beam_matrices(4, free=True)
    given = {"mass": M, "stiffness": K, "boundary": [8], "modes": 2, "fixed": [0, 1]} | changes
    with pytest.raises(ModelError, match=message):
        craig_bampton(given.pop("mass"), given.pop("stiffness"), **given)
