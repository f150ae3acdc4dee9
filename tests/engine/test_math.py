"""Elementary functions in machine code against NumPy's, which has more digits on most platforms."""

import casadi as ca
import numpy as np
import pytest

from backsight.engine import lanes, native
from engine.examples import recursion

N = 4096
X = ca.SX.sym("x")
FUNCTIONS = {name: getattr(ca, name)(X) for name in ("exp", "log", "tanh", "sin", "cos")}
SPECIAL = [
    0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 2.0**-1022, 709.78271289338397,
    709.79, 745.2, -745.13, -745.14, -746.0, 1e300, -1e300, 22.0, -22.1, np.pi, 1e22, 2.0**40,
]  # fmt: skip


def arguments() -> dict[str, np.ndarray]:
    """Arguments of all sizes, and more of those where a function changes its way."""
    rng = np.random.default_rng(7)
    sizes = np.ldexp(rng.uniform(1.0, 2.0, N), rng.integers(-1074, 1024, N))
    return {
        "all sizes": rng.choice([-1.0, 1.0], N) * sizes,
        "small": rng.uniform(-2.0, 2.0, N),
        "around one": 1.0 + rng.uniform(-1e-3, 1e-3, N),
        "exponents": rng.uniform(-746.0, 711.0, N),
        "angles": rng.uniform(-2e12, 2e12, N),
        "quarters of turns": np.round(rng.uniform(-1e9, 1e9, N)) * (np.pi / 2),
        "special": np.array(SPECIAL),
    }


@pytest.fixture(scope="module")
def outcome():
    """Arguments, and for every function its values alone and in one of several lanes."""
    c = ca.SX.sym("c")
    r = recursion(ca.Function("elementary", [c, X], [c, *FUNCTIONS.values()]))
    x = np.concatenate(list(arguments().values()))
    _, single = native.run(r, [x[:, None]], carry=r.carry0)
    # In the other lanes are other arguments, so that near and far angles come together.
    data = [[np.roll(x, shift)[:, None]] for shift in (0, 5, 700)]
    _, together = lanes.run_many(r, data, carries=[r.carry0] * 3)[0]
    return x, {n: (s[:, 0], t[:, 0]) for n, s, t in zip(FUNCTIONS, single, together, strict=True)}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_within_a_few_units_in_the_last_place(outcome, name):
    x, values = outcome
    with np.errstate(all="ignore"):
        exact = getattr(np, name)(x.astype(np.longdouble))
        expected = exact.astype(float)
    single, _ = values[name]
    finite = np.isfinite(expected)
    np.testing.assert_array_equal(single[~finite], expected[~finite])
    error = np.abs(single[finite] - exact[finite]) / np.spacing(np.abs(expected[finite]))
    assert error.max() < 4


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_lane_as_alone(outcome, name):
    single, together = outcome[1][name]
    np.testing.assert_array_equal(together, single)


def test_tanh_keeps_the_sign_of_zero(outcome):
    x, values = outcome
    zero = x == 0
    np.testing.assert_array_equal(np.signbit(values["tanh"][0][zero]), np.signbit(x[zero]))


def test_the_arithmetic_around_may_not_be_mixed_with_the_reduction():
    c = ca.SX.sym("c")
    r = recursion(ca.Function("around", [c, X], [c, ca.sin(3 * X - 1) * 2, ca.exp(-2 * X) + X]))
    x = np.random.default_rng(8).uniform(-300.0, 300.0, 500)
    _, (sine, exponential) = native.run(r, [x[:, None]], carry=r.carry0)
    # An argument that is rounded otherwise changes the result as much as its derivative says.
    np.testing.assert_allclose(sine[:, 0], 2 * np.sin(3 * x - 1), atol=1e-12)
    np.testing.assert_allclose(exponential[:, 0], np.exp(-2 * x) + x, rtol=1e-12)
