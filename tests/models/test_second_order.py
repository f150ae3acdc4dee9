"""Structures: against NumPy's linear algebra, known eigenfrequencies and the equation of motion."""

import casadi as ca
import numpy as np
import pytest

from backsight.errors import ModelError
from backsight.models import Signal, augment, sdof
from backsight.models.lti import state_space
from backsight.models.structures import second_order

ROW = {
    "mass": [["m1", 0], [0, "m2"]],
    "damping": [[0.3, -0.1], [-0.1, 0.1]],
    "stiffness": [["k1 + k2", "-k2"], ["-k2", "k2"]],
    "forces": {"c*V": "q1", "w": "q2"},
    "inputs": {"V": "V"},
    "parameters": {"m1": 1.0, "m2": 2.0, "k1": 900.0, "k2": 400.0, "c": 5.0, "w": (0.0, "N")},
    "outputs": {"y": ("displacement", "q1"), "a": ("acceleration", "q2")},
}


@pytest.mark.parametrize("n", [1, 2, 7])
def test_matrices_are_those_of_the_equation_of_motion(n: int) -> None:
    rng = np.random.default_rng(n)
    factor = rng.standard_normal((n, n))
    M, K = factor @ factor.T + n * np.eye(n), factor.T @ factor
    C = 0.01 * K + 0.1 * M
    directions, weights = rng.standard_normal((n, 2)), rng.standard_normal((3, n))
    kinds = ("displacement", "velocity", "acceleration")
    model = second_order(
        M,
        C,
        K,
        forces={"u1": directions[:, 0], "3*u2": list(directions[:, 1])},
        inputs={"u1": "N", "u2": "N"},
        outputs={kind[0]: (kind, weights[i]) for i, kind in enumerate(kinds)},
    )
    L = directions * [1, 3]
    inverse = np.linalg.inv(M)
    bottom = np.hstack([-inverse @ K, -inverse @ C])
    a, b, c, d = state_space(model)
    np.testing.assert_allclose(a[:n], np.hstack([np.zeros((n, n)), np.eye(n)]))
    np.testing.assert_allclose(a[n:], bottom, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(b, np.vstack([np.zeros((n, 2)), inverse @ L]), atol=1e-13)
    np.testing.assert_allclose(c[0], [*weights[0], *np.zeros(n)])
    np.testing.assert_allclose(c[1], [*np.zeros(n), *weights[1]])
    np.testing.assert_allclose(c[2], weights[2] @ bottom, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(d, [[0, 0], [0, 0], weights[2] @ inverse @ L], atol=1e-13)


def test_eigenfrequencies_of_a_chain() -> None:
    # Equal masses and springs between two walls: 2 sqrt(k/m) sin(i pi / (2 (n + 1))).
    n, m, k = 6, 2.0, 50.0
    stiffness = k * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    model = second_order(
        m * np.eye(n), np.zeros((n, n)), stiffness, forces={}, outputs={"y": ("velocity", "q3")}
    )
    frequencies = np.sort(np.abs(np.linalg.eigvals(state_space(model)[0]).imag))[::2]
    i = np.arange(1, n + 1)
    np.testing.assert_allclose(
        frequencies, 2 * np.sqrt(k / m) * np.sin(i * np.pi / (2 * (n + 1))), rtol=1e-10
    )


def test_formulas_in_the_matrices_follow_the_parameters() -> None:
    model = second_order(**ROW)
    x, u, theta = [1.0, -2.0, 0.5, 0.25], 3.0, [2.0, 4.0, 10.0, 20.0, 7.0, 1.5]
    M, K = np.diag([2.0, 4.0]), np.array([[30.0, -20.0], [-20.0, 20.0]])
    expected = np.linalg.solve(M, [21.0, 1.5] - np.array(ROW["damping"]) @ x[2:] - K @ x[:2])
    np.testing.assert_allclose(at(model.f, x, u, theta), [*x[2:], *expected])
    np.testing.assert_allclose(at(model.h, x, u, theta), [1.0, expected[1]])


def test_coupled_mass_with_formulas_is_solved() -> None:
    given = ROW | {"mass": [["m1 + m2", "m2"], ["m2", "m2"]]}
    x, theta = [1.0, -2.0, 0.5, 0.25], [2.0, 4.0, 10.0, 20.0, 7.0, 1.5]
    M, K = np.array([[6.0, 4.0], [4.0, 4.0]]), np.array([[30.0, -20.0], [-20.0, 20.0]])
    expected = np.linalg.solve(M, [21.0, 1.5] - np.array(ROW["damping"]) @ x[2:] - K @ x[:2])
    model = second_order(**given)
    np.testing.assert_allclose(at(model.f, x, 3.0, theta)[2:], expected, rtol=1e-12)


def test_gain_and_unknown_force_become_states() -> None:
    joint = augment(second_order(**ROW), ["k1", "c", "w"])
    assert [s.name for s in joint.states] == ["q1", "q2", "q1_dot", "q2_dot", "k1", "c", "w"]
    x, u = ca.SX.sym("x", joint.nx), ca.SX.sym("u", 1)
    jacobian = ca.Function("Z", [x, u], [ca.jacobian(joint.rhs(x, u), x)])
    Z = np.array(jacobian([0.1, 0, 0, 0, 900, 5, 0], 3.0))
    # Derivatives with respect to k1 (through q1 / m1), c (through V / m1) and w (through 1 / m2).
    np.testing.assert_allclose(Z[2:4, 4:], [[-0.1, 3.0, 0.0], [0.0, 0.0, 0.5]], atol=1e-15)
    np.testing.assert_array_equal(Z[4:], np.zeros((3, 7)))


def test_stage_with_a_mass_equals_the_stage_per_mass() -> None:
    # Eq. 35 with m = 2 against eq. 36 with k/m, b/m, c/m.
    whole = second_order(
        "m",
        "b",
        "k",
        coordinates={"q": "um"},
        forces={"c*u": "q", "fu": [1]},
        inputs={"u": "V"},
        parameters={"m": 2.0, "b": 3.0, "k": 8.0, "c": 5.0, "fu": 0.0},
        outputs={"y": ("displacement", "q")},
    )
    for ours, per_mass in zip(
        state_space(whole), state_space(sdof(k=4.0, b=1.5, c=2.5)), strict=True
    ):
        np.testing.assert_allclose(ours, per_mass)


def test_a_free_body_and_a_cubic_spring_are_allowed() -> None:
    free = second_order(2.0, 0.0, 0.0, forces={"F": "q1"}, inputs={"F": "N"}, outputs=_y("q1"))
    np.testing.assert_array_equal(state_space(free)[0], [[0, 1], [0, 0]])
    spring = second_order(2.0, 0.0, 0.0, forces={"-4*q1**3": "q1"}, outputs=_y("q1"))
    np.testing.assert_allclose(at(spring.f, [2.0, 1.0], [], []), [1.0, -16.0])


def test_names_and_units_of_states_and_outputs() -> None:
    model = second_order(
        np.diag([1.0, 1e-18]),  # a mass beside a small moment of inertia
        np.zeros((2, 2)),
        np.zeros((2, 2)),
        coordinates={"tip": Signal("mm", scale=0.1), "tilt": "rad"},
        forces={},
        outputs={
            "a": ("acceleration", "tip"),
            "s": ("velocity", "tilt"),
            "y": ("displacement", [1, 1]),
        },
    )
    assert [s.name for s in model.states] == ["tip", "tilt", "tip_dot", "tilt_dot"]
    assert [s.unit for s in model.states] == ["mm", "rad", "mm/s", "rad/s"]
    assert [s.unit for s in model.outputs] == ["mm/s2", "rad/s", ""]
    assert model.states[0].scale == 0.1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"mass": [["m1", 0], [0, 0]]}, "not positive definite: its smallest eigenvalue is 0"),
        ({"mass": [[1, 2], [2, 1]]}, "not positive definite: its smallest eigenvalue is -1"),
        ({"mass": [[1, 0.5], [0, 1]]}, "not symmetric: row 1, column 2 is 0.5, its mirror image 0"),
        ({"mass": [[1, 0]]}, r"1 rows|mass has the shape \(1, 2\)"),
        ({"mass": [["1/w", 0], [0, 1]]}, "mass is not finite"),
        ({"damping": 0.1}, r"damping has the shape \(\); it must be \(2, 2\)"),
        ({"stiffness": [[1, 2], [3]]}, r"stiffness has the shape \(2,\)"),
        ({"stiffness": [[1, "k3"], [0, 1]]}, "stiffness, row 1, column 2, column 1: unknown name"),
        ({"stiffness": [["q1", 0], [0, 1]]}, "unknown name 'q1'"),
        ({"damping": [[1, None], [0, 1]]}, "damping, row 1, column 2 is None"),
        ({"damping": [[1, np.inf], [0, 1]]}, "damping, row 1, column 2 is inf"),
        ({"damping": [[1, 10**400], [0, 1]]}, "damping, row 1, column 2 is 1000"),
        ({"damping": [[1, np.nan], [0, 1]]}, "damping, row 1, column 2 is nan"),
        ({"stiffness": {"k": 1}}, r"stiffness has the shape \(\)"),
        ({"forces": {"c*U": "q1"}}, "force 'c.U', column 3: unknown name 'U'"),
        ({"forces": {"V": "q3"}}, "force 'V' is at the coordinate 'q3': did you mean"),
        ({"forces": {"V": [1, 0, 0]}}, r"direction of force 'V' has the shape \(3,\)"),
        ({"outputs": {"y": ("position", "q1")}}, "output 'y' is a 'position': "),
        ({"outputs": {"y": "q1"}}, "output 'y' is 'q1'; give"),
        ({"outputs": {"y": ("velocity", 1)}}, "direction of output 'y' has the shape"),
        ({"coordinates": {"a": "m"}}, "1 coordinates are named, but the mass matrix has 2 rows"),
        ({"coordinates": {"w": "m", "a": "m"}, "forces": {}, "outputs": {}}, "is used twice"),
        ({"coordinates": {"sin": "m", "a": "m"}}, "'sin' is a function"),
    ],
)
def test_wrong_descriptions_are_refused(change: dict, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        second_order(**ROW | change)


def _y(where: str) -> dict[str, tuple[str, str]]:
    return {"y": ("displacement", where)}


def at(function: ca.Function, *arguments: object) -> np.ndarray:
    return function(*arguments).full().ravel()
