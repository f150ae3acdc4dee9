"""Kinks and poles in formulas: the limit where there is one, else the equation is named."""

import casadi as ca
import numpy as np
import pytest

import backsight as bs
from backsight.algebra.expressions import expression
from backsight.errors import DataError, EstimationError


def value_and_slope(text: str, x: float, y: float) -> tuple[float, np.ndarray]:
    symbols = {name: ca.SX.sym(name) for name in ("x", "y")}
    read = expression(text, symbols, where="formula")
    both = ca.vertcat(*symbols.values())
    f = ca.Function("f", [both], [read, ca.densify(ca.jacobian(read, both))])
    value, slope = f([x, y])
    return float(value), np.array(slope)[0]


@pytest.mark.parametrize(
    ("text", "value", "slope"),
    [
        ("hypot(x, y)", 0, (0, 0)),
        ("sqrt(x*x + 4*y**2)", 0, (0, 0)),
        ("sin(x)/x", 1, (0, 0)),
        ("tanh(3*x)/x", 3, (0, 0)),
        ("(exp(x) - 1)/x", 1, (0.5, 0)),
        ("y*sin(x)/x", 0, (0, 1)),
        ("(1 - cos(x))/x", 0, (0.5, 0)),
        ("x*abs(x)", 0, (0, 0)),
    ],
)
def test_limits_at_zero(text, value, slope):
    found, slopes = value_and_slope(text, 0.0, 0.0)
    assert found == pytest.approx(value, abs=1e-15)
    np.testing.assert_allclose(slopes, slope, atol=1e-15)
    near, beside = value_and_slope(text, 1e-4, 1e-12)
    assert near == pytest.approx(value + slope[0] * 1e-4, abs=3e-4)
    assert np.isfinite(beside).all()


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("hypot(x, y)", np.hypot), ("sqrt(x**2 + y**2)", np.hypot),
        ("sin(x)/x", lambda x, y: np.sin(x) / x), ("x/y", lambda x, y: x / y),
        ("sqrt(x + y)", lambda x, y: np.sqrt(x + y)), ("x/(x*y)", lambda x, y: 1 / y),
    ],
)  # fmt: skip
def test_nothing_changes_elsewhere(text, exact):
    assert value_and_slope(text, 0.3, 0.8)[0] == pytest.approx(exact(0.3, 0.8), rel=1e-15)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("-sign(q)*sqrt(abs(q))", r"equation of 'q' has no finite derivative by 'q' at q = 0"),
        ("-q/abs(q)", r"equation of 'q' is not finite at q = 0"),
        ("atan2(q, abs(q))", r"equation of 'q' has no finite derivative by 'q' at q = 0"),
        ("-log(q)", r"equation of 'q' is not finite at q = 0"),
    ],
)
def test_the_equation_is_named(text, says):
    model = bs.from_equations(
        states={"q": "m"}, outputs={"y": "m"}, equations={"q": text}, output_equations={"y": "q"}
    )
    recording = bs.from_arrays(y=np.zeros((5, 1)), dt=0.1, inputs={}, outputs={"y": "m"})
    e = bs.EKF(
        bs.Noise(sigma_y=0.1), bs.Prior(sigma_x0=0.1), integrator=bs.Integrator("rk4", substeps=1)
    )
    with pytest.raises(EstimationError, match=says + r".*round the kink or pole off"):
        bs.estimate(e, model, recording, engine="vm")
    message = bs.estimate(e, model, recording, engine="vm", throw=False).attrs["culprit"]
    assert "sub-steps" not in message


def test_an_estimate_that_diverged_otherwise_blames_no_equation():
    model = bs.from_equations(
        states={"q": "m"}, outputs={"y": "m"}, equations={"q": "q**3"}, output_equations={"y": "q"}
    )
    recording = bs.from_arrays(
        y=np.full((60, 1), np.nan), dt=1.0, inputs={}, outputs={"y": "m"}
    )  # fmt: skip
    e = bs.EKF(
        bs.Noise(sigma_y=0.1), bs.Prior(sigma_x0=0.1, x0={"q": 3.0}),
        integrator=bs.Integrator("rk4", substeps=1),
    )  # fmt: skip
    result = bs.estimate(e, model, recording, engine="vm", throw=False)
    assert result.status.values.any()
    assert "culprit" not in result.attrs


def tank():
    return bs.from_equations(
        states={"level": "m"}, inputs={"u": ""}, outputs={"y": "m"}, parameters={"c": 0.5},
        equations={"level": "u - c*sqrt(level)"}, output_equations={"y": "level"},
    )  # fmt: skip


def test_a_simulation_names_the_equation_with_the_parameters_of_the_sample():
    with pytest.raises(DataError, match=r"t = 0.1 s: the equation of 'level' is not finite at lev"):
        bs.simulate(tank(), [[0.0]] * 9, dt=0.05, x0={"level": 1e-3}, parameters={"c": 0.7})


def test_points_around_the_estimate_are_looked_at_too():
    """Sigma points of a level that is nearly zero are below zero."""
    y = np.full((5, 1), 1e-3)
    given = bs.data.from_arrays(
        u=np.full((5, 1), 0.5 * 1e-3**0.5), y=y, dt=0.05, inputs={"u": ""}, outputs={"y": "m"}
    )
    ukf = bs.UKF(bs.Noise(sigma_y=1e-3), bs.Prior(sigma_x0=0.1))
    with pytest.raises(EstimationError, match=r"equation of 'level' is not finite at level = −"):
        bs.estimate(ukf, tank(), given, engine="vm")
