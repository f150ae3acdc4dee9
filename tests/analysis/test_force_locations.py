"""How many random-walk forces are observable, and transmission zeros."""

import numpy as np
import pytest

from backsight.analysis.observability import (
    check_force_locations,
    check_observability,
    force_zeros,
    transmission_zeros,
)
from backsight.discrete.exact import zoh
from backsight.errors import ModelError
from backsight.models import augment, lti
from backsight.models.lti import state_space
from backsight.models.structures import beam

DT = 1 / 400
NODES = 0.125 + 0.04 * np.arange(8)


def cantilever(kinds=("displacement",) * 3, at=(3, 5, 7), **changes):
    """The beam of Kirchner et al. 2018 with unknown forces at eight nodes."""
    return beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502.0,
        sensors={f"s{i}": (kind, NODES[i]) for kind, i in zip(kinds, at, strict=True)},
        **{"forces": {f"F{i}": x for i, x in enumerate(NODES)}, "damping": [0.030, 0.037, 0.119]}
        | changes,
    )


def test_observable_up_to_nine_states():
    """Fig. 5 of that paper: the rank is the number of states up to nine, and stays nine."""
    found = check_force_locations(cantilever(), DT)
    expected = [6, 7, 8, 9, 9, 9, 9, 9, 9]
    for name in ("rank", "pbh"):
        np.testing.assert_array_equal(found[name], [expected, expected])
    np.testing.assert_array_equal(found["states"], np.arange(6, 15))
    np.testing.assert_array_equal(found["observable"], [[True] * 4 + [False] * 5] * 2)
    assert found["weakest"].min() > 5e-5
    assert found["next"].max() < 1e-15
    assert (found.attrs["rank_forces"], found.attrs["rank_static"], found.attrs["most"]) == (
        3,
        3,
        3,
    )
    assert found.attrs["verdict"] == (
        "beam: random-walk forces at up to 3 of 8 places are observable (9 states), in either "
        "order: constant forces show in 3 sensors, one number in each; the forces move the states "
        "in 3 ways (modes) only"
    )


def test_ranks_are_those_of_the_continuous_joint_model():
    """The test for observability of a model, which works by projections, on the augmented model."""
    model = cantilever(("displacement", "acceleration", "strain"), at=(7, 5, 1))
    found = check_force_locations(model, DT, forces=["F6", "F1", "F3"])
    for n in range(4):
        for order, names in (("forward", ["F6", "F1", "F3"]), ("backward", ["F3", "F1", "F6"])):
            joint = augment(model, names[:n])
            assert check_observability(joint).rank == found["rank"].sel(order=order, number=n)


@pytest.mark.parametrize(
    ("changes", "most", "words"),
    [
        ({"kinds": ("acceleration",) * 3}, 0, "constant forces do not show in s3, s5, s7"),
        (
            {"kinds": ("displacement", "velocity", "acceleration")},
            1,
            "constant forces show in one sensor, .*; constant forces do not show in s5, s7",
        ),
        ({"kinds": ("displacement",) * 5, "at": (1, 2, 3, 5, 7)}, 3, r": the forces .* 3 ways"),
        ({"forces": {"F": 0.2, "G": 0.4}}, 2, "2 of 2 places .* all of them"),
    ],
)
def test_what_limits_the_number_is_said(changes, most, words):
    found = check_force_locations(cantilever(**changes), DT)
    assert found.attrs["most"] == most
    np.testing.assert_array_equal(found["pbh"], found["rank"])
    with pytest.raises(AssertionError, match=words):
        raise AssertionError(found.attrs["verdict"])


def test_the_order_counts():
    """Two forces at one place cannot be told apart, wherever they come in the row."""
    found = check_force_locations(cantilever(forces={"a": 0.2, "b": 0.2, "c": 0.4}), DT)
    np.testing.assert_array_equal(found["rank"], [[6, 7, 7, 8], [6, 7, 8, 8]])
    assert found.attrs["most"] == 1


def test_a_free_beam_and_one_that_is_not_seen():
    """Rigid motion has the eigenvalue of the random walks; a sensor in a node sees half of it."""
    free = {"boundary": "free-free", "modes": 3, "damping": 0.01}
    assert check_force_locations(cantilever(**free), DT).attrs["most"] == 3
    hidden = beam(
        0.4,
        boundary="free-free",
        modes=2,
        bending_stiffness=1.0,
        mass_per_length=1.0,
        sensors={"y": ("displacement", 0.2)},
        forces={"F": 0.1},
    )
    found = check_force_locations(hidden, DT)
    assert found.attrs["most"] == -1
    assert "not observable even without forces" in found.attrs["verdict"]


def test_names_and_models_are_checked():
    with pytest.raises(ModelError, match="did you mean 'F7'"):
        check_force_locations(cantilever(), DT, forces=["F77"])


def test_transmission_zeros_of_modal_forces():
    """From an independent implementation: near -1, the zeros that sampling brings in."""
    A, _, C, _ = state_space(cantilever())
    E = np.vstack([np.zeros((3, 3)), np.eye(3)])
    A, E = zoh(A, E, dt=DT)
    expected = [-0.997251019358, -0.978432474073, -0.788642114011]
    zeros = transmission_zeros(A, E, C, np.zeros((3, 3)))
    np.testing.assert_allclose(zeros, expected, rtol=1e-10)
    # Eight places act through these three.
    np.testing.assert_allclose(force_zeros(cantilever(), DT), expected, rtol=1e-9)


def test_zeros_are_the_roots_of_the_numerator():
    """One input, one output; companion form, with and without feedthrough."""
    A = np.array([[0.0, 1, 0], [0, 0, 1], [-0.1, 0.2, 0.3]])
    E, poles = np.array([[0.0], [0], [1]]), np.array([1, -0.3, -0.2, 0.1])
    numerator = np.array([2.0, 0.4, -1.2])
    zeros = transmission_zeros(A, E, numerator[None, ::-1], [[0.0]])
    np.testing.assert_allclose(np.sort(zeros), np.sort(np.roots(numerator)), atol=1e-12)
    zeros = transmission_zeros(A, E, numerator[None, ::-1], [[0.5]])
    expected = np.roots(0.5 * poles + [0, *numerator])
    np.testing.assert_allclose(np.sort_complex(zeros), np.sort_complex(expected), atol=1e-12)


def test_a_second_sensor_takes_zeros_away_unless_it_shares_them():
    A = np.diag([0.5, 0.4, 0.9])
    E, first = np.ones((3, 1)), np.array([1.0, -0.4, 0.3])
    alone = transmission_zeros(A, E, first[None], [[0.0]])
    assert len(alone) == 2
    both = np.vstack([first, [1.0, 2.0, 3.0]])
    assert len(transmission_zeros(A, E, both, np.zeros((2, 1)))) == 0
    twice = np.vstack([first, 2 * first])
    np.testing.assert_allclose(transmission_zeros(A, E, twice, np.zeros((2, 1))), alone, atol=1e-9)


def test_forces_that_do_not_show_at_once_have_no_zeros_here():
    delayed = lti(
        [[0.5, 1.0], [0, 0.4]], [[0], [1.0]], [[1.0, 0]],
        states={"a": "", "b": ""}, inputs={"u": ""}, outputs={"y": ""}, dt=1.0,
    )  # fmt: skip
    with pytest.raises(ModelError, match="1 forces show in one sample in only 0 independent ways"):
        transmission_zeros(*state_space(delayed))
