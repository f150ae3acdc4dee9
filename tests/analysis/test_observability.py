"""Verdicts on models whose hidden states are known, and their words."""

import numpy as np
import pytest

from backsight.analysis.observability import check_observability, check_observability_along
from backsight.errors import ModelError
from backsight.models.augment import augment
from backsight.models.builtin import sdof
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.text.equations import from_equations


def linear(A, C, *, names, dt=None):
    ny = len(C)
    return lti(A, np.zeros((len(A), 0)), C, states=dict.fromkeys(names, ""), inputs={}, dt=dt,
               outputs={f"y{i}": "" for i in range(ny)}, name="plant")  # fmt: skip


def chain(n: int, outputs) -> Model:
    """Masses in a row with springs between them only; free at both ends."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[0, 0] = K[-1, -1] = 1
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-900 * K, -0.3 * K]])
    names = [f"q{i + 1}" for i in range(n)] + [f"v{i + 1}" for i in range(n)]
    return linear(A, outputs, names=names)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_rank_and_index_are_those_of_the_observability_matrix(n):
    """Random systems with a hidden part of known size behind a random change of states."""
    rng = np.random.default_rng(n)
    for hidden in range(3):
        size = n + hidden
        A = np.zeros((size, size))
        A[:n, :n], A[n:, :] = rng.standard_normal((n, n)), rng.standard_normal((hidden, size))
        C = np.hstack([rng.standard_normal((1, n)), np.zeros((1, hidden))])
        T = rng.standard_normal((size, size))
        seen = linear(T @ A @ np.linalg.inv(T), C @ np.linalg.inv(T), dt=1.0,
                      names=[f"x{i}" for i in range(size)])  # fmt: skip
        found = check_observability(seen)
        assert found.rank == n
        assert found.samples == n
        assert len(found.hidden) == hidden
        assert found.observable == (hidden == 0)
        growing = np.abs(np.linalg.eigvals(A[n:, n:])) >= 1
        assert len(found.lasting) >= growing.any()
        assert found.detectable == (not growing.any())


def test_free_chain_measured_by_its_speed_is_not_detectable():
    """All masses moved together: no spring is stretched and no speed changes."""
    found = check_observability(chain(2, [[0.0, 0.0, 1.0, 0.0]]))
    assert found.hidden == ("q1 and q2 in the ratio 1 : 1",)
    assert not found.detectable
    assert found.lasting[0][0] == pytest.approx(0, abs=1e-6)
    assert found.repairs == ("q1", "q2")
    words = str(found)
    assert "not detectable" in words
    assert "3 of 4 states seen" in words
    assert "any one of these would do: q1, q2" in words


def test_long_chain_is_observable_from_its_end():
    """The powers of A span 60 decades here; a rank of the stacked matrix would be wrong."""
    found = check_observability(chain(10, [np.eye(20)[0]]))
    assert found.observable
    assert found.samples == 20
    assert str(found).startswith("plant: observable, 20 samples suffice")


def test_mode_with_its_node_at_the_sensor_decays():
    """The sensor on the middle mass of three does not see the outer ones move against it."""
    found = check_observability(chain(3, [np.eye(6)[1]]))
    assert found.hidden == ("q1 and q3 in the ratio 1 : -1", "v1 and v3 in the ratio 1 : -1")
    assert found.detectable
    assert not found.lasting
    assert set(found.repairs) == {"q1", "q3", "v1", "v3"}
    assert "decays by itself" in str(found)


def test_verdict_does_not_depend_on_units():
    A = np.array([[0.0, 1.0, 0.0], [-9e6, -30.0, 0.0], [0.0, 0.0, -5.0]])
    T = np.diag([1e6, 1e-3, 1e3])
    for M in (np.eye(3), T):
        plant = linear(M @ A @ np.linalg.inv(M), np.array([[1.0, 0, 0]]) @ np.linalg.inv(M),
                       names="abc")  # fmt: skip
        assert check_observability(plant).hidden == ("c",)


def test_given_candidates_are_tried():
    sensors = {
        "accelerometer": lambda x, u, p: -900 * (x.q1 - x.q2),
        "potentiometer": lambda x, u, p: x.q2,
    }
    found = check_observability(chain(2, [[0.0, 0.0, 1.0, 0.0]]), candidates=sensors)
    assert found.repairs == ("potentiometer",)
    none = check_observability(
        chain(2, [[0.0, 0.0, 1.0, 0.0]]), candidates={"gyro": lambda x, u, p: x.v2}
    )
    assert "no single candidate" in str(none)


STAGE = augment(sdof(k=900.0, b=1.0, c=5.0), ["k", "b", "c"])
START = np.array([0.1, 0.0, 900.0, 1.0, 5.0])


def test_parameters_show_only_while_the_machine_moves():
    n = 200
    rng = np.random.default_rng(1)
    moving = check_observability_along(STAGE, rng.standard_normal((n, 1)), dt=0.01, x0=START)
    assert moving.observable
    assert 5 <= moving.samples <= 20
    free = check_observability_along(STAGE, np.zeros((n, 1)), dt=0.01, x0=START)
    assert free.hidden == ("c",)
    rest = check_observability_along(STAGE, np.zeros((n, 1)), dt=0.01, x0=START * [0, 0, 1, 1, 1])
    assert rest.hidden == ("k", "b", "c")
    assert "excite the machine" in str(rest)
    assert "over 200 samples" in str(rest)


def test_ratio_of_parameters_is_named():
    """Mass, damping, stiffness and gain are only determined up to a common factor."""
    scaled = Model(
        f=lambda x, u, p: [x.v, (u.F * x.g - x.k * x.q - 0.5 * x.m * x.v) / x.m, 0, 0, 0],
        h=lambda x, u, p: [x.q],
        states={"q": 0.1, "v": 0.0, "m": 2.0, "k": 900.0, "g": 3.0},
        inputs={"F": "N"},
        outputs={"y": "m"},
    )
    rng = np.random.default_rng(2)
    found = check_observability_along(scaled, rng.standard_normal((300, 1)), dt=0.01)
    assert found.rank == 4
    assert found.hidden == ("m, k and g in the ratio 1 : 450 : 1.5",)
    assert set(found.repairs) == {"m", "k", "g"}


def test_on_a_linear_model_both_ways_agree():
    plant = chain(3, [np.eye(6)[1]])
    along = check_observability_along(plant, np.zeros((200, 0)), dt=0.01, x0=np.arange(6.0))
    assert along.rank == check_observability(plant).rank
    assert along.hidden == check_observability(plant).hidden


def test_motion_that_explodes_is_reported():
    growing = Model(f=lambda x, u, p: [x.a**3], h=lambda x, u, p: [x.a], states={"a": 10.0},
                    outputs={"y": ""})  # fmt: skip
    with pytest.raises(ModelError, match="not finite from sample"):
        check_observability_along(growing, np.zeros((50, 0)), dt=0.1)


def test_nonlinear_model_needs_a_motion():
    with pytest.raises(ModelError, match="not linear"):
        check_observability(STAGE)


def test_force_that_is_zero_in_the_motion_is_seen_in_any_unit():
    for unit in (1.0, 1e6):
        pushed = Model(
            f=lambda x, u, p, unit=unit: [x.v, -x.k * x.q - x.v + u.F + x.w / unit, 0, 0],
            h=lambda x, u, p: [x.q],
            states={"q": 0.1, "v": 0.0, "k": 900.0, "w": 0.0},
            inputs={"F": "N"},
            outputs={"y": "m"},
        )
        rng = np.random.default_rng(3)
        assert check_observability_along(pushed, rng.standard_normal((200, 1)), dt=0.01).observable


def test_a_motion_that_is_lost_names_the_equation():
    valve = from_equations(
        states={"w": ""}, inputs={"u": ""}, outputs={"y": ""},
        equations={"w": "u - sqrt(abs(w))*sign(w)"}, output_equations={"y": "w"},
    )  # fmt: skip
    with pytest.raises(ModelError, match="equation of 'w' has no finite derivative by 'w'"):
        check_observability_along(valve, np.ones((5, 1)), dt=0.1)
