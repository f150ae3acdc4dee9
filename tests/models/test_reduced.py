"""Matrices as users have them: the reduced model answers as the whole structure does."""

import numpy as np
import pytest
import scipy.sparse as sparse
from tests.models.finite_elements import at, beam_matrices, frequencies, response, two

from backsight.errors import BacksightWarning, ModelError
from backsight.models.lti import state_space
from backsight.models.structures import forces_as_inputs, reduced

TIP = {"sensors": {"y": ("displacement", 38)}, "inputs": {"F": 38}}


def test_sparse_is_dense():
    M, K = beam_matrices(20)
    dense = at(reduced(M, K, modes=4, damping=0.01, **TIP), 100j)
    for kind in (sparse.csr_matrix, sparse.coo_array):
        found = reduced(kind(M), kind(K), modes=4, damping=0.01, **TIP)
        np.testing.assert_allclose(at(found, 100j), dense, rtol=1e-12)


def test_large_structures_stay_sparse():
    """A cantilever of 1000 elements: 2000 coordinates, by shift and invert."""
    M, K = beam_matrices(1000)
    given = {"sensors": {"y": ("displacement", 1998)}, "inputs": {"F": 1998}}
    found = reduced(sparse.csc_array(M), sparse.csc_array(K), modes=4, damping=0.01, **given)
    coarse = reduced(*beam_matrices(20), modes=4, damping=0.01, **TIP)
    np.testing.assert_allclose(frequencies(found), frequencies(coarse), rtol=1e-4)
    np.testing.assert_allclose(at(found, 100j), at(coarse, 100j), rtol=1e-3)


@pytest.mark.parametrize("part", [np.triu, np.tril])
def test_a_triangle_is_completed(part):
    M, K = beam_matrices(20)
    whole = reduced(M, K, modes=3, damping=0.01, **TIP)
    with pytest.warns(BacksightWarning, match="stiffness: a triangle was given"):
        found = reduced(M, part(K), modes=3, damping=0.01, **TIP)
    np.testing.assert_array_equal(state_space(found)[0], state_space(whole)[0])


def test_a_row_of_masses_is_a_diagonal():
    _, K = beam_matrices(20)
    masses = np.linspace(1, 2, len(K))
    row, matrix = (reduced(m, K, modes=3, damping=0.01, **TIP) for m in (masses, np.diag(masses)))
    np.testing.assert_array_equal(state_space(row)[0], state_space(matrix)[0])


def test_coordinates_without_mass_follow_statically():
    """Against condensation by hand (Guyan), which is exact for them."""
    M, K = beam_matrices(20, lumped=True)
    m, s = np.arange(0, 40, 2), np.arange(1, 40, 2)
    condensed = K[np.ix_(m, m)] - K[np.ix_(m, s)] @ np.linalg.solve(
        K[np.ix_(s, s)], K[np.ix_(s, m)]
    )
    expected = reduced(
        M[np.ix_(m, m)], condensed, modes=4, damping=0.01,
        sensors={"y": ("displacement", 19)}, inputs={"F": 19},
    )  # fmt: skip
    with pytest.warns(BacksightWarning, match=r"20 coordinates \(1, .* 8 more\) have no mass"):
        found = reduced(M, K, modes=4, damping=0.01, **TIP)
    for w in (0, 100j):
        np.testing.assert_allclose(at(found, w), at(expected, w), rtol=1e-9)


def test_a_moment_on_a_coordinate_without_mass():
    M, K = beam_matrices(5, lumped=True)
    given = {"sensors": {"slope": ("displacement", 9)}, "inputs": {"T": 9}}
    exact = np.linalg.inv(K)[9, 9]
    with pytest.warns(BacksightWarning, match="have no mass"):
        found = reduced(M, K, modes=2, damping=0.01, residual="modes", **given)
    assert at(found, 0).item() == pytest.approx(exact, rel=1e-9)


def test_a_coordinate_of_nothing_is_left_out():
    M, K = beam_matrices(20)
    empty = np.zeros((1, 1))
    with pytest.warns(BacksightWarning, match=r"coordinate \(40\) has neither mass nor stiffness"):
        found = reduced(two(M, empty), two(K, empty), modes=3, damping=0.01, **TIP)
    np.testing.assert_allclose(frequencies(found), frequencies(
        reduced(M, K, modes=3, damping=0.01, **TIP)), rtol=1e-12)  # fmt: skip


def test_fixed_coordinates_and_constraints():
    """A free beam held at a node, and another one fixed to its tip by equations: one long beam."""
    M, K = beam_matrices(10, length=0.5, free=True)
    n = len(M)
    whole = reduced(*beam_matrices(20), modes=4, damping=0.01, **TIP)
    joined = [{n - 2: 1, n: -1}, {n - 1: 1, n + 1: -1}]
    for constraints in (joined, np.eye(2, 2 * n, n - 2) - np.eye(2, 2 * n, n)):
        found = reduced(
            two(M, M), two(K, K), modes=4, damping=0.01, fixed=[0, 1], constraints=constraints,
            sensors={"y": ("displacement", 2 * n - 2)}, inputs={"F": 2 * n - 2},
        )  # fmt: skip
        np.testing.assert_allclose(at(found, 50j), at(whole, 50j), rtol=1e-8)


def test_equations_that_say_the_same_twice():
    M, K = beam_matrices(4, free=True)
    given = {"sensors": {"y": ("displacement", 9)}, "modes": 2, "damping": 0.01}
    once = reduced(M, K, constraints=[{0: 1, 2: -1}, {1: 1}], **given)
    twice = reduced(M, K, constraints=[{0: 1, 2: -1}, {1: 1}, {0: -3, 2: 3, 1: 1}], **given)
    np.testing.assert_allclose(frequencies(once), frequencies(twice), rtol=1e-9)


def test_places_by_name():
    M, K = beam_matrices(2)
    names = ["2:UY", "2:RZ", "3:UY", "3:RZ"]
    given = {"modes": 2, "damping": 0.01, "coordinates": names}
    by_name = reduced(
        M, K, sensors={"y": ("displacement", "3:UY")}, inputs={"F": {"2:UY": 0.5}}, **given
    )
    by_number = reduced(
        M, K, sensors={"y": ("displacement", 2)}, inputs={"F": [0.5, 0, 0, 0]}, **given
    )
    np.testing.assert_array_equal(at(by_name, 9j), at(by_number, 9j))
    del given["coordinates"]
    by_text = reduced(M, K, sensors={"y": ("displacement", "2")}, inputs={"F": {"0": 0.5}}, **given)
    np.testing.assert_array_equal(at(by_text, 9j), at(by_number, 9j))
    given["coordinates"] = names
    with pytest.raises(ModelError, match="sensor 'y' is at the coordinate '3:UX': did you mean"):
        reduced(M, K, sensors={"y": ("displacement", "3:UX")}, **given)


@pytest.mark.parametrize("residual", ["modes", "feedthrough"])
@pytest.mark.parametrize("free", [False, True])
def test_residuals_answer_statically_right(residual, free):
    """Where two forces act, two modes with residuals have the flexibility of the whole beam."""
    M, K = beam_matrices(20, free=free)
    places = {"a": 10, "b": 30}
    given = {
        "modes": 2 + 2 * free,
        "damping": 0.01,
        "sensors": {k: ("displacement", i) for k, i in places.items()},
        "forces": places,
    }
    found = forces_as_inputs(reduced(M, K, residual=residual, **given), list(places))
    plain = forces_as_inputs(reduced(M, K, **given), list(places))
    slow = 2j * np.pi * 0.3
    exact = response(M, np.zeros_like(M), K, slow)[np.ix_([10, 30], [10, 30])]
    error, without = (np.abs(at(m, slow) / exact - 1).max() for m in (found, plain))
    assert error < (2e-4 if free else 2e-3)  # the damping, which `exact` lacks
    assert without > 5 * error
    if not free:
        np.testing.assert_allclose(
            at(found, 0), np.linalg.inv(K)[np.ix_([10, 30], [10, 30])], rtol=1e-7
        )
    assert found.nx == 2 * (given["modes"] + 2 * (residual == "modes"))


def test_kinds_of_damping():
    M, K = beam_matrices(10)
    given = {"modes": 3, "sensors": {"y": ("displacement", 18)}, "inputs": {"F": 18}}
    alpha, beta = 0.3, 2e-5
    rayleigh = reduced(M, K, rayleigh=(alpha, beta), **given)
    matrix = reduced(M, K, damping_matrix=alpha * M + beta * K, **given)
    np.testing.assert_allclose(at(rayleigh, 30j), at(matrix, 30j), rtol=1e-9)
    loss, ratio = reduced(M, K, loss_factor=0.02, **given), reduced(M, K, damping=0.01, **given)
    np.testing.assert_array_equal(at(loss, 30j), at(ratio, 30j))
    both = reduced(M, K, rayleigh=(alpha, beta), damping=0.01, **given)
    rates = [np.diag(state_space(m)[0])[3:] for m in (both, rayleigh, ratio)]
    np.testing.assert_allclose(rates[0], rates[1] + rates[2], rtol=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fixed": range(4)}, "nothing can move"),
        ({"fixed": ["a"]}, "fixed is at the coordinate 'a': they have no names"),
        ({"fixed": [7]}, "fixed is at coordinate 7; there are 0 to 3"),
        ({"coordinates": ["a", "b", "c"]}, "3 coordinates are named, but the matrices have 4 rows"),
        ({"coordinates": ["a", "b", "a", "c"]}, "two coordinates are called 'a'"),
        ({"constraints": np.ones((1, 3))}, "constraints have 3 columns; 4 coordinates need"),
        ({"damping": [0.1, 0.1, 0.1]}, "damping has the size"),
        ({"loss_factor": 2.5}, "damping ratio of mode 1 is 1.26"),
        ({"residual": "static"}, "residual"),
        ({"damping": None}, "give either damping"),
        ({"sensors": {"y": ("pace", 0)}}, "sensor 'y' is a 'pace'"),
        ({"inputs": {"F": {0: "x"}}}, "input 'F' has the weight 'x'"),
        ({"forces": {"F": "c*sin(t)"}}, r"force 'F' is given the formula 'c\*sin\(t\)'"),
        ({"forces": {"F": {0: "c*u"}}}, r"formula 'c\*u'; .* from_equations"),
        ({"forces": {"F": {"at": 0, "expression": "-k*q1"}}}, r"formula '-k\*q1'"),
        ({"ground": {"a": "UX"}}, "ground 'a' moves 'UX': the coordinates have no names"),
    ],
)
def test_what_cannot_be_is_said(changes, message):
    M, K = beam_matrices(2)
    given = {"modes": 2, "damping": 0.01, "sensors": {"y": ("displacement", 0)}} | changes
    with pytest.raises(ModelError, match=message):
        reduced(M, K, **given)


@pytest.mark.parametrize("kind", [np.asarray, sparse.csc_array])
def test_a_complex_stiffness_is_refused_and_not_cut(kind):
    M, K = beam_matrices(2)
    with pytest.raises(ModelError, match=r"stiffness is complex; .* as loss_factor = eta"):
        reduced(M, kind(K * (1 + 0.02j)), modes=2, damping=0.01, **TIP)
