"""Structures by modes and by reduced matrices: the same motion as the structure they come from."""

import numpy as np
import pytest

from backsight.errors import ModelError
from backsight.models.forces.unknown_forces import forces_as_inputs
from backsight.models.lti import state_space
from backsight.models.structures import beam, modal, reduced, second_order

N = 5
STIFFNESS = 1e4 * (2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
MASS = np.diag([1.0, 2.0, 1.5, 1.0, 3.0])
SENSORS = {"y": ("displacement", 0), "a": ("acceleration", 3), "e": ("strain", [1.0, -1, 0, 0, 0])}
FORCES = {"F": 1, "G": [0.0, 0, 1, -1, 0]}


def responses(model, frequency):
    """Outputs per input at a frequency [rad/s]."""
    A, B, C, D = state_space(model)
    return C @ np.linalg.solve(1j * frequency * np.eye(len(A)) - A, B) + D


def full(damping):
    """The structure with all of its coordinates."""
    axis = np.eye(N)
    return second_order(
        MASS,
        damping,
        STIFFNESS,
        forces={"F": axis[1], "G": axis[2] - axis[3]},
        inputs={"F": "N", "G": "N"},
        outputs={
            "y": ("displacement", axis[0]),
            "a": ("acceleration", axis[3]),
            "e": ("displacement", axis[0] - axis[1]),
        },
    )


@pytest.mark.parametrize("coupled", [False, True])
def test_all_modes_are_the_whole_structure(coupled):
    damping = 2e-4 * STIFFNESS + (np.diag([3.0, 0, 0, 0, 0]) if coupled else 0.5 * MASS)
    model = reduced(
        MASS, STIFFNESS, modes=N, damping_matrix=damping, sensors=SENSORS, inputs=FORCES
    )
    for frequency in (0.0, 30.0, 77.0, 200.0):
        expected = responses(full(damping), frequency)
        np.testing.assert_allclose(responses(model, frequency), expected, rtol=1e-9, atol=1e-12)
    assert [s.unit for s in model.outputs] == ["m", "m/s2", ""]


def test_first_modes_are_kept():
    """The eigenvalues of two modes are those of the structure, lowest first."""
    model = reduced(MASS, STIFFNESS, modes=2, damping=0.02, sensors=SENSORS, inputs=FORCES)
    squares = np.linalg.eigvals(np.linalg.solve(MASS, STIFFNESS)).real
    omega = np.sqrt(np.sort(squares)[:2])
    A = state_space(model)[0]
    np.testing.assert_allclose(A[2:, :2], -np.diag(omega**2), rtol=1e-10)
    np.testing.assert_allclose(A[2:, 2:], -np.diag(0.04 * omega), rtol=1e-10)


def test_a_free_structure_moves_as_a_whole():
    free = 1e4 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    model = reduced(
        np.diag([1.0, 3.0]), free, modes=1, damping=0.1,
        sensors={"a": ("acceleration", 0)}, inputs={"F": 1},
    )  # fmt: skip
    A, _, _, D = state_space(model)
    assert not A[1].any()
    assert D.item() == pytest.approx(1 / 4)


def test_modes_of_a_beam_from_its_tables():
    """Frequencies and shapes as a modal test gives them, scaled to a tip of one."""
    sizes = {"width": 0.03, "thickness": 0.004, "youngs_modulus": 70e9, "density": 2700.0}
    places = {"sensors": {"a": ("acceleration", 0.6)}, "inputs": {"F": 0.2}}
    expected = beam(0.6, modes=2, damping=[0.01, 0.02], **sizes, **places)
    A, B, C, _ = state_space(
        beam(0.6, modes=2, sensors={"y": ("displacement", 0.6)}, inputs={"F": 0.2}, **sizes)
    )
    tip = C[0, :2]
    model = modal(
        np.sqrt(-np.diag(A[2:, :2])) / (2 * np.pi),
        damping=[0.01, 0.02],
        sensors={"a": ("acceleration", [1.0, 1.0])},
        inputs={"F": B[2:, 0] / tip},
        modal_masses=tip**-2,
    )
    for frequency in (10.0, 300.0):
        expect = responses(expected, frequency)
        np.testing.assert_allclose(responses(model, frequency), expect, rtol=1e-10)


def test_other_units():
    model = modal(
        [10.0],
        sensors={"y": ("velocity", [1.0])},
        forces={"F": [1.0]},
        length_unit="mm",
        force_unit="mN",
    )
    assert (model.outputs[0].unit, model.parameters[0].unit) == ("mm/s", "mN")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frequencies": [-1.0, 2.0]}, "frequencies is"),
        ({"frequencies": []}, "frequencies is"),
        ({"frequencies": ["a", 2.0]}, "frequencies must be numbers"),
        ({"damping": [0.1, np.nan]}, "damping has an entry that is not finite"),
        ({"damping": [0.1, -0.1]}, "damping ratio of mode 2 is -0.1"),
        ({"damping": np.eye(3)}, r"damping has the shape \(3, 3\); 2 modes need \(2, 2\)"),
        ({"modal_masses": [1.0, 0.0]}, "modal_masses is"),
        ({"forces": {"F": [1.0]}}, r"shapes of force 'F' have the size \(1,\); 2 modes need"),
        ({"forces": {"F": [0.0, 0.0]}}, "force 'F' moves no mode"),
        ({"inputs": {"F": [0.0, 0.0]}}, "input 'F' moves no mode"),
        ({"sensors": {"y": ("strain", [0.0, 0.0])}}, "sensor 'y' sees no mode"),
        ({"sensors": {"y": ("place", [0.0, 1.0])}}, "sensor 'y' is a 'place'"),
        ({"sensors": {"y": [1.0, 1.0]}}, r"give \(kind, where\)"),
    ],
)
def test_bad_modes_are_said(changes, message):
    given = {
        "frequencies": [10.0, 20.0],
        "damping": 0.01,
        "sensors": {"y": ("displacement", [1.0, 1.0])},
    } | changes
    with pytest.raises(ModelError, match=message):
        modal(given.pop("frequencies"), **given)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": np.ones((5, 4))}, r"mass has the shape \(5, 4\); it must be square"),
        ({"mass": np.diag([1.0, 1, -1e-3, 1, 1])}, "mass is not positive definite"),
        ({"mass": MASS + np.eye(N, k=1) + 0.9 * np.eye(N, k=-1)}, "mass is not symmetric"),
        ({"stiffness": np.eye(3)}, r"stiffness has the shape \(3, 3\), but mass \(5, 5\)"),
        ({"stiffness": -STIFFNESS}, "stiffness is not positive semidefinite"),
        ({"modes": 6}, "modes is 6; with 5 coordinates it must be from 1 to 5"),
        ({"damping": None}, "give either damping"),
        ({"damping_matrix": MASS}, "give either damping"),
        ({"damping": None, "damping_matrix": np.eye(2)}, "damping_matrix has the shape"),
        ({"forces": {"F": 5}}, "force 'F' is at coordinate 5; there are 0 to 4"),
        ({"forces": {"F": [1.0, 2.0]}}, r"force 'F' has \(2,\) weights"),
    ],
)
def test_bad_matrices_are_said(changes, message):
    given = {"mass": MASS, "stiffness": STIFFNESS, "modes": 3, "damping": 0.01, "sensors": SENSORS}
    given |= changes
    with pytest.raises(ModelError, match=message):
        reduced(given.pop("mass"), given.pop("stiffness"), **given)


def test_a_force_at_a_node_of_all_kept_modes():
    """The middle of three equal masses stands still in the second mode, here the only one left."""
    chain = 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    shaped = reduced(
        np.eye(3), chain, modes=2, damping=0.01, sensors={"y": ("displacement", 0)}, forces={"F": 1}
    )
    B = state_space(forces_as_inputs(shaped, ["F"]))[1][:, 0]
    assert B[2] != 0
    assert B[3] == 0.0
