"""Models from equations as text."""

import casadi as ca
import numpy as np
import pytest

from backsight.errors import ModelError
from backsight.models import Signal, augment, friction_drive, from_equations

DRIVE = {
    "states": {"q": "m", "v": "m/s"},
    "inputs": {"F": "N"},
    "outputs": {"y": "m"},
    "parameters": {"M": (95.0, "kg"), "Fv": 203.0, "Fc": 20.0, "offset": -3.0, "vs": 1e-3},
    "equations": {"q": "v", "v": "(F - Fv*v - Fc*tanh(v/vs) - offset)/M"},
    "output_equations": {"y": "q"},
}


def test_text_gives_the_same_model_as_python() -> None:
    text = from_equations(**DRIVE)
    python = friction_drive(M=95.0, Fv=203.0, Fc=20.0, offset=-3.0)
    rng = np.random.default_rng(1)
    for _ in range(5):
        x, u = rng.standard_normal(2) * 1e-3, rng.standard_normal(1) * 100
        np.testing.assert_allclose(
            at(text.f, x, u, text.theta), at(python.f, x, u, python.theta), rtol=1e-14
        )
        np.testing.assert_array_equal(at(text.h, x, u, text.theta), x[:1])


def test_units_values_and_bounds_are_kept() -> None:
    given = DRIVE["parameters"] | {"M": Signal("kg", value=95.0, lower=1.0)}
    model = from_equations(**DRIVE | {"parameters": given}, name="drive")
    assert model.name == "drive"
    assert model.continuous
    assert model.parameters[0] == Signal("kg", value=95.0, lower=1.0, name="M")
    assert [s.unit for s in model.states] == ["m", "m/s"]


def test_parameters_become_states_as_in_any_other_model() -> None:
    joint = augment(from_equations(**DRIVE), ["M", "offset"])
    assert [s.name for s in joint.states] == ["q", "v", "M", "offset"]
    x = [0.0, 0.1, 90.0, -3.0]
    np.testing.assert_allclose(
        at(joint.f, x, 100.0, joint.theta),
        [0.1, (100 - 20.3 - 20.0 * np.tanh(100) + 3) / 90, 0, 0],
    )


def test_order_of_the_equations_does_not_matter() -> None:
    swapped = dict(reversed(DRIVE["equations"].items()))
    a, b = from_equations(**DRIVE), from_equations(**DRIVE | {"equations": swapped})
    np.testing.assert_array_equal(at(a.f, [1, 2], 3, a.theta), at(b.f, [1, 2], 3, b.theta))


def test_discrete_time_and_feedthrough() -> None:
    model = from_equations(
        states={"a": 1.0, "b": 2.0},
        inputs={"u": "V"},
        outputs={"y": "", "z": ""},
        equations={"a": "a + 0.1*b", "b": "0.9*b + u"},
        output_equations={"z": "2*u - b", "y": "a"},
        dt=0.1,
    )
    assert not model.continuous
    np.testing.assert_allclose(at(model.f, [1, 2], 3, []), [1.2, 4.8])
    np.testing.assert_allclose(at(model.h, [1, 2], 3, []), [1, 4])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"equations": {"q": "v"}}, "no entry for v"),
        ({"equations": {**DRIVE["equations"], "w": "0"}}, "an entry 'w'"),
        ({"output_equations": {}}, "no entry for y"),
        ({"output_equations": {"y": "q", "a": "v"}}, "an entry 'a': did you mean|an entry 'a'"),
        ({"equations": {"q": "v", "v": "force/M"}}, "equation 'v', column 1: unknown name 'force'"),
        ({"equations": {"q": "y", "v": "F"}}, "unknown name 'y'"),
        ({"equations": {"q": "v", "v": 3}}, "equation 'v' is 3; write it as text"),
        ({"parameters": {"pi": 3.0}}, "'pi' is a constant"),
        ({"inputs": {"sin": ""}}, "'sin' is a function"),
        ({"inputs": {"q": ""}}, "'q' is used twice"),
        ({"states": {"q": "m", "v 1": "m/s"}}, "'v 1' is not a name"),
    ],
)
def test_wrong_descriptions_are_refused(change: dict, reason: str) -> None:
    with pytest.raises(ModelError, match=reason):
        from_equations(**DRIVE | change)


def test_all_faulty_equations_are_told_at_once() -> None:
    faulty = {"equations": {"q": "v^2", "v": "f/M"}, "output_equations": {"y": "Q + 1"}}
    with pytest.raises(ModelError) as caught:
        from_equations(**DRIVE | faulty)
    message = str(caught.value)
    assert "equation 'q', column 2" in message
    assert "equation 'v', column 1: unknown name 'f': known: " in message
    assert "output equation 'y', column 1" in message


def at(function: ca.Function, *arguments: object) -> np.ndarray:
    return function(*arguments).full().ravel()
