"""Describing quantities without a sensor."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.errors import ModelError
from backsight.models.forces.unknown_forces import forces_as_inputs


def values(model, x, u=(), w=None):
    w = np.zeros(model.nx) if w is None else w
    return np.asarray(model.virtual.g(x, u, model.theta, w)).ravel()


STAGE = bs.sdof(k=100.0, b=2.0, c=3.0)  # v_dot = -100 q - 2 v + 3 u


def test_formulas_take_all_names_and_those_before_them():
    model = bs.with_virtual(
        STAGE, {"spring": ("k*q", "N"), "half": "spring/2", "acc": ("v_dot", "m/s2"), "seen": "2*y"}
    )
    np.testing.assert_allclose(
        values(model, [0.1, 0.5], [2.0], [0.0, 7.0]), [10.0, 5.0, -10 - 1 + 6 + 7, 0.2]
    )
    assert [s.unit for s in model.virtual.signals] == ["N", "", "m/s2", ""]
    assert "virtual     spring [N], half, acc [m/s2], seen" in str(model)


def test_functions_have_the_rates_as_their_last_argument():
    model = bs.with_virtual(STAGE, {"power": (lambda x, u, p, dx: x.v * dx.v, "W")})
    model = bs.with_virtual(model, {"more": lambda x, u, p, dx: ca.fabs(x.q)})
    np.testing.assert_allclose(values(model, [-0.1, 0.5], [0.0]), [0.5 * 9.0, 0.1])


@pytest.mark.parametrize(
    ("quantities", "message"),
    [
        ({"q": "v"}, "'q' has the name of another signal"),
        ({"a b": "v"}, "'a b' is not a name"),
        ({"z": "stifness*q"}, "virtual output 'z', column 1: unknown name 'stifness'"),
        ({"sin": "q"}, "'sin' is a function"),
        ({"z": lambda x, u, p, dx: x.w}, "the model has no state 'w'"),
        ({"z": lambda x, u, p, dx: ca.vertcat(x.q, x.v)}, "give one name each"),
        ({"z": lambda x, u, p, dx: "q"}, "not a number or expression"),
    ],
)
def test_what_is_wrong_is_said(quantities, message):
    with pytest.raises(ModelError, match=message):
        bs.with_virtual(STAGE, quantities)


def test_in_discrete_time_there_are_no_rates():
    model = bs.lti(
        [[0.5]], [[1.0]], [[1.0]], states={"x": ""}, inputs={"u": ""}, outputs={"y": ""}, dt=0.1
    )
    with pytest.raises(ModelError, match="unknown name 'x_dot'"):
        bs.with_virtual(model, {"rate": "x_dot"})
    step = bs.with_virtual(model, {"next": lambda x, u, p, dx: dx.x})
    np.testing.assert_allclose(values(step, [2.0], [3.0], [0.5]), [4.5])


def test_they_stay_what_they_are_when_the_model_changes():
    plain = bs.second_order(
        1.0, "b", "k", forces={"F": "q1", "c*V": "q1"}, inputs={"V": "V"},
        parameters={"b": 2.0, "k": 100.0, "F": 0.0, "c": 3.0},
        outputs={"y": ("displacement", "q1")}, virtual={"a": ("acceleration", "q1")},
    )  # fmt: skip
    wide = bs.augment(plain, ["k", "F"], disturbances={"d": "q1_dot"})
    x = [0.1, 0.5, 90.0, 4.0, 0.25]  # q1, q1_dot, k, F, d
    np.testing.assert_allclose(values(wide, x, [1.0]), [-9 - 1 + 4 + 3 + 0.25])
    known = forces_as_inputs(plain, ["F"])
    np.testing.assert_allclose(values(known, x[:2], [1.0, 4.0]), [-10 - 1 + 4 + 3])
    lagged = bs.models.with_sensors(
        plain, {s.name: bs.models.Sensor(cutoff=50.0) for s in plain.outputs}
    )
    np.testing.assert_allclose(values(lagged, [*x[:2], 0.0], [1.0]), [-10 - 1 + 3])
    with pytest.raises(ModelError, match="of a model with other signals"):
        dataclasses.replace(plain, inputs=(), f=lambda x, u, p: [0, 0], h=lambda x, u, p: [x.q1])


def test_structures_take_them_like_sensors():
    beam = bs.beam(
        1.0, bending_stiffness=100.0, mass_per_length=2.0, thickness=0.01, modes=2,
        sensors={"y": ("displacement", 1.0), "e": ("strain", 0.1)}, forces={"F": 1.0},
        virtual={"tip": ("displacement", 1.0), "root": ("strain", 0.1), "a": ("acceleration", 1.0)},
    )  # fmt: skip
    x = np.array([0.1, -0.2, 0.3, 0.4])
    seen = np.asarray(beam.h(x, [], beam.theta)).ravel()
    np.testing.assert_allclose(values(beam, x)[:2], seen)
    assert [s.unit for s in beam.virtual.signals] == ["m", "", "m/s2"]
    for wrong, message in (
        ({"z": ("stress", 0.1)}, "virtual 'z' is a 'stress'"),
        ({"z": ("displacement", 2.0)}, "virtual 'z' is at 2 m, off the beam"),
        ({"y": ("displacement", 1.0)}, "'y' has the name of another signal"),
    ):
        with pytest.raises(ModelError, match=message):
            bs.beam(
                1.0, bending_stiffness=1.0, mass_per_length=1.0,
                sensors={"y": ("displacement", 1.0)}, virtual=wrong,
            )  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*not symmetric")
@pytest.mark.parametrize("skew", [0.0, 5.0])
def test_reduced_structures_answer_where_no_sensor_is_as_a_sensor_would(skew):
    chain = 1e3 * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    chain[0, 1] += skew
    kinds = ("displacement", "velocity", "acceleration")
    wanted = {f"{kind[0]}2": (kind, 2) for kind in kinds}
    given = {
        "mass": np.eye(4), "stiffness": chain, "modes": 2, "damping": 0.01,
        "inputs": {"G": 0}, "forces": {"F": 1},
    }  # fmt: skip
    if not skew:
        given["residual"] = "feedthrough"
    model = bs.reduced(**given, sensors={"y": ("displacement", 0)}, virtual=wanted)
    seen = bs.reduced(**given, sensors={"y": ("displacement", 0), **wanted})
    rng = np.random.default_rng(0)
    x, u, w = rng.standard_normal(model.nx), [0.7], rng.standard_normal(model.nx)
    expected = np.asarray(seen.h(x, u, [3.0])).ravel()
    model, seen = (
        dataclasses.replace(m, parameters=(dataclasses.replace(m.parameters[0], value=3.0),))
        for m in (model, seen)
    )
    np.testing.assert_allclose(values(model, x, u), expected[1:], rtol=1e-12)
    assert [s.unit for s in model.virtual.signals] == ["m", "m/s", "m/s2"]
    # The noise of the rates moves an acceleration as it moves the rate of the velocity.
    shift = values(model, x, u, w) - values(model, x, u)
    along = np.asarray(seen.h(x + 1e-3 * w, u, [3.0])).ravel() - expected
    np.testing.assert_allclose(shift, [0, 0, along[2] / 1e-3], rtol=1e-6, atol=1e-9)
