"""The built-in machines against their equations of motion."""

import casadi as ca
import numpy as np
import pytest

from backsight.errors import ModelError
from backsight.models import Model, Signal, augment, duffing, friction_drive, sdof


def at(model: Model, x: object, u: float) -> np.ndarray:
    return model.f(x, u, model.theta).full().ravel()


def test_joint_model_of_the_stage_in_scaled_variables() -> None:
    # Numbers of eq. 37 from an independent NumPy implementation: scaled state and its derivative.
    scales = np.array([5.0, 1e4, 7e6, 70.0, 8e5, 1e5])
    x, u = scales * [0.3, -0.4, 1.1, 0.9, 0.7, 0.25], 5 * 0.35
    stage = sdof(k=7e6, b=70.0, c=8e5, length="um", drive="V")
    joint = augment(stage, ["k", "b", "c"], disturbances={"w": "v"})
    assert [s.name for s in joint.states] == ["q", "v", "k", "b", "c", "w"]
    np.testing.assert_allclose(at(joint, x, u) / scales, [-800.0, -1029.3, 0, 0, 0, 0], rtol=1e-12)

    symbol = ca.SX.sym("x", 6)
    jacobian = ca.Function("Z", [symbol], [ca.jacobian(joint.rhs(symbol, u), symbol)])
    np.testing.assert_allclose(
        np.array(jacobian(x))[1] * scales / scales[1],
        [-3850.0, -63.0, -1050.0, 28.0, 140.0, 10.0],
        rtol=1e-12,
    )


def test_duffing_has_a_cubic_spring() -> None:
    model = duffing(k1=9.0, d=0.5, k3=2.0, b=3.0)
    np.testing.assert_allclose(at(model, [2.0, 1.0], 4.0), [1.0, -18 - 0.5 - 16 + 12])
    np.testing.assert_array_equal(model.h([2.0, 1.0], 4.0, model.theta).full(), [[2.0]])


def test_drive_keeps_its_speed_where_the_force_equals_the_friction() -> None:
    model = friction_drive(M=95.0, Fv=200.0, Fc=20.0, offset=-3.0, vs=1e-3)
    np.testing.assert_allclose(at(model, [0.1, 0.25], 50 + 20 - 3), [0.25, 0.0], atol=1e-13)
    np.testing.assert_allclose(at(model, [0.1, -0.25], -50 - 20 - 3), [-0.25, 0.0], atol=1e-13)
    np.testing.assert_allclose(at(model, [0.0, 0.0], 95 - 3), [0.0, 1.0])
    at_vs = at(model, [0.0, 1e-3], 0.0)[1] * 95 + 0.2 - 3
    assert at_vs == pytest.approx(-20 * np.tanh(1))


def test_units_follow_length_and_drive() -> None:
    stage = sdof(k=1.0, b=1.0, length="um", drive="V")
    assert [s.unit for s in stage.parameters] == ["1/s2", "1/s", "um/s2/V"]
    assert [s.unit for s in stage.states] == ["um", "um/s"]
    assert [stage.inputs[0].unit, stage.outputs[0].unit] == ["V", "um"]
    silverbox = duffing(k1=1.0, d=1.0, k3=1.0, length="V", drive="V")
    assert [s.unit for s in silverbox.parameters] == ["1/s2", "1/s", "1/s2/V2", "V/s2/V"]
    drive = friction_drive(M=1.0, Fv=1.0, Fc=1.0)
    assert [s.unit for s in drive.parameters] == ["kg", "N s/m", "N", "N", "m/s"]


def test_physical_bounds() -> None:
    lower = {
        s.name: s.lower
        for model in (
            sdof(k=1.0, b=1.0),
            duffing(k1=1.0, d=1.0, k3=-1.0),
            friction_drive(M=50.0, Fv=1.0, Fc=1.0, vs=1e-3),
        )
        for s in model.parameters
    }
    zero = {"k", "k1", "d", "Fv", "Fc"}
    assert all(lower[name] == 0 for name in zero)
    assert all(np.isneginf(lower[name]) for name in ("c", "k3", "b", "offset"))
    assert lower["M"] == pytest.approx(0.05)  # the equation divides by it
    assert lower["vs"] == pytest.approx(1e-6)


def test_a_signal_brings_its_own_unit_and_bounds() -> None:
    model = sdof(k=Signal("rad2/s2", value=3.0, upper=9.0, scale=2.0), b=0.1)
    assert model.parameters[0] == Signal("rad2/s2", value=3.0, upper=9.0, scale=2.0, name="k")
    drive = friction_drive(M=Signal("t", value=0.1, lower=0.05), Fv=1.0, Fc=1.0)
    assert drive.parameters[0].lower == 0.05


@pytest.mark.parametrize(
    ("build", "reason"),
    [
        (lambda: sdof(k=-1.0, b=0.1), "value of 'k' is -1.0, outside its bounds"),
        (lambda: sdof(k=None, b=0.1), "parameter 'k': give a unit, a value"),
        (lambda: duffing(k1=1.0, d=-0.1, k3=0.0), "value of 'd' is -0.1"),
        (lambda: friction_drive(M=0.0, Fv=1.0, Fc=1.0), "value of 'M' is 0.0; it must be positive"),
        (lambda: friction_drive(M=1.0, Fv=1.0, Fc=1.0, vs=-1.0), "value of 'vs' is -1.0"),
    ],
)
def test_impossible_values_are_refused(build, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        build()
