"""Order of convergence of every tableau, with held and ramped inputs, and sub-steps."""

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from backsight.discrete.runge_kutta import TABLEAUS, Integrator
from backsight.errors import TuningError
from backsight.estimators import Noise, Prior
from backsight.estimators.kalman.prediction import COVARIANCES, predict
from backsight.estimators.scaled import setting
from backsight.models.model import Model

DT = 0.5
INPUT = [1.0, -0.6, 0.8, 0.2]
START = np.array([0.7, -0.4])
RANGES = {
    "euler": (64, 256), "heun": (64, 256), "rk4": (32, 128), "dopri5": (8, 32),
    "implicit_midpoint": (64, 256), "sdirk": (64, 256), "radau": (64, 256),
}  # fmt: skip
"""Sub-steps between which the error falls with the order: above rounding, below the first terms."""


def slope(x, u):
    """A damped oscillator with a hardening spring."""
    return np.array([x[1], -4 * x[0] - 0.5 * x[1] - x[0] ** 3 + u])


def grid(hold: str) -> list[tuple[float, float]]:
    """Input at the start and at the end of each of three sampling periods."""
    ends = INPUT[1:] if hold == "foh" else INPUT[:-1]
    return list(zip(INPUT[:-1], ends, strict=True))


@pytest.fixture(scope="module", params=["zoh", "foh"])
def hold(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def exact(hold) -> np.ndarray:
    """State after three periods, by an eighth-order method with tiny steps."""
    x = START
    for a, b in grid(hold):
        solved = solve_ivp(
            lambda t, x, a=a, b=b: slope(x, a + (b - a) * t / DT),
            (0, DT), x, method="DOP853", rtol=3e-14, atol=1e-15,
        )  # fmt: skip
        x = solved.y[:, -1]
    return x


def integrated(integrator: Integrator) -> np.ndarray:
    x, n = START, integrator.substeps
    step = stepping(integrator)
    for a, b in grid(integrator.hold):
        for i in range(n):
            ua, ub = a + (b - a) * i / n, a + (b - a) * (i + 1) / n
            x = step(x, ua, ub)
    return x


def stepping(integrator: Integrator):
    """One sub-step: on numbers, or, with the expressions that an implicit one needs, compiled."""
    h = DT / integrator.substeps
    if not TABLEAUS[integrator.scheme].implicit:
        return lambda x, ua, ub: integrator.substep(slope, x, ua=ua, ub=ub, h=h)
    x, ua, ub = ca.SX.sym("x", 2), ca.SX.sym("ua"), ca.SX.sym("ub")

    def rates(x, u):
        return ca.vertcat(x[1], -4 * x[0] - 0.5 * x[1] - x[0] ** 3 + u)

    moved = ca.Function("moved", [x, ua, ub], [integrator.substep(rates, x, ua=ua, ub=ub, h=h)])
    return lambda *values: np.asarray(moved(*values))[:, 0]


def test_every_tableau_is_tested():
    assert set(RANGES) == set(TABLEAUS)


@pytest.mark.parametrize("scheme", TABLEAUS)
def test_order_of_convergence(scheme, hold, exact):
    coarse, fine = RANGES[scheme]
    errors = [
        np.linalg.norm(integrated(Integrator(scheme, n, hold)) - exact) for n in (coarse, fine)
    ]
    order = np.log(errors[0] / errors[1]) / np.log(fine / coarse)
    assert order == pytest.approx(TABLEAUS[scheme].order, abs=0.05)


@pytest.mark.parametrize("scheme", TABLEAUS)
def test_tableau_is_consistent(scheme):
    """Weights sum to one, and sum b c = 1/2, sum b c^2 = 1/3, sum b A c = 1/6 up to the order."""
    tableau = TABLEAUS[scheme]
    b, c = np.array(tableau.b), np.array(tableau.c)
    A = np.array([[*row, *[0.0] * (len(b) - len(row))] for row in tableau.a])
    assert b.sum() == pytest.approx(1.0, abs=1e-15)
    if tableau.order >= 2:
        assert b @ c == pytest.approx(1 / 2, abs=1e-15)
    if tableau.order >= 3:
        assert b @ c**2 == pytest.approx(1 / 3, abs=1e-15)
        assert b @ A @ c == pytest.approx(1 / 6, abs=1e-15)


@pytest.mark.parametrize("covariance", COVARIANCES)
@pytest.mark.parametrize("substeps", [1, 3])
def test_time_update_takes_these_substeps(hold, substeps, covariance):
    """The filter's compiled time update is the plain loop above, scaling undone."""
    model = Model(
        f=lambda x, u, p: [x.v, -4 * x.q - 0.5 * x.v - x.q**3 + u.F],
        h=lambda x, u, p: [x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m"},
    )
    s = setting(model, DT, noise=Noise(sigma_y=0.1), prior=Prior(sigma_x0={"q": 2.0, "v": 3.0}))
    integrator = Integrator("rk4", substeps, hold)
    ahead = predict(s, integrator, covariance)
    x = ca.DM(START / s.sx)
    for a, b in itertools.pairwise(INPUT):
        x, _ = ahead(x, np.zeros(3), a, b)
    np.testing.assert_allclose(s.sx * np.asarray(x)[:, 0], integrated(integrator), rtol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"scheme": "rk5"}, "did you mean 'rk4'"),
        ({"hold": "linear"}, "unknown hold 'linear'"),
        ({"substeps": 0}, "substeps is 0"),
        ({"substeps": 1.5}, "substeps is 1.5"),
    ],
)
def test_wrong_descriptions_are_refused(arguments, message):
    with pytest.raises(TuningError, match=message):
        Integrator(**arguments)


def test_numpy_integers_are_whole_numbers():
    assert Integrator(substeps=np.int64(4)).substeps == 4
