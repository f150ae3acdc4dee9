"""A limit that holds the noise against the data: the iterations end, at the optimum."""

import casadi as ca
import numpy as np

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.estimators import MHE, Limit, Noise, Prior
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.run.estimation import solve_window
from backsight.schema import Status, recording
from backsight.solvers.box import GaussNewton

DT, N = 0.1, 6
SIGMA_Y, SIGMA_W, SIGMA_X0 = (
    np.array(k) for k in ([0.02, 0.05], [0.0, 0.03, 0.02], [0.3, 0.5, 0.3])
)
LEAST = -0.005
"""Bound of the noise on the speed."""


def slope(x, u):
    """Swing with quadratic drag and a cubic spring that is a state."""
    return [x[1], -2 * np.sin(x[0]) - 0.3 * x[1] * abs(x[1]) - x[2] * x[0] ** 3 + u, 0.0]


def step(x, u):
    k1 = np.array(slope(x, u))
    k2 = np.array(slope(x + DT / 2 * k1, u))
    k3 = np.array(slope(x + DT / 2 * k2, u))
    k4 = np.array(slope(x + DT * k3, u))
    return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def test_iterations_end_at_a_point_within_the_limit():
    rng, n = np.random.default_rng(5), 26
    x, u = np.array([0.6, 1.0, 1.0]), 2 * np.sin(0.5 * np.arange(n))
    y = np.zeros((n, 2))
    for k in range(n):
        seen = [np.cos(x[0]) + 0.3 * x[0], x[1] ** 2 / 2]
        y[k] = seen + rng.multivariate_normal([0, 0], np.diag(SIGMA_Y**2))
        x = step(x, u[k]) + np.array([0, 0.03, 0.0]) * rng.standard_normal(3)
    model = Model(
        f=lambda x, u, p: [
            x.v, -2 * ca.sin(x.q) - 0.3 * x.v * ca.fabs(x.v) - x.k * x.q**3 + u.F, 0,
        ],
        h=lambda x, u, p: [ca.cos(x.q) + 0.3 * x.q, x.v**2 / 2],
        states={"q": Signal(value=0.4), "v": Signal(value=0.8), "k": Signal(value=0.6)},
        inputs={"F": ""},
        outputs={"y": "", "z": ""},
    )  # fmt: skip
    estimator = MHE(
        Noise(R=np.diag(SIGMA_Y**2), Q=np.diag(SIGMA_W**2)),
        Prior(P0=np.diag(SIGMA_X0**2)),
        N=N,
        integrator=Integrator("rk4"),
        optimiser=GaussNewton(60, tolerance=1e-9),
        limits=(Limit("drive", {"v": 1.0}, lower=LEAST, upper=0.02, of="noise"),),
    )
    recursion = estimator.compile(model, DT)
    _, outputs = vm.run(recursion, [u[:, None], y, np.ones_like(y)], carry=recursion.carry0)
    results = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    assert not np.any(results["status"].astype(int) & ~int(Status.CLIPPED))
    data = recording(
        np.arange(n) * DT, u=u[:, None], y=y, inputs={"F": ""}, outputs={"y": "", "z": ""}, dt=DT
    )
    found = solve_window(estimator, model, data, at=21)
    states, first = found["x"].values, 21 - N
    noise = [states[i + 1] - step(states[i], u[first + i]) for i in range(N)]
    np.testing.assert_allclose(found["w"].values[1:], noise, atol=1e-9)
    held = found["side"].values[1:, 0] != 0
    assert held.any()
    np.testing.assert_allclose(np.array(noise)[:, 1].min(), LEAST, atol=1e-9)
