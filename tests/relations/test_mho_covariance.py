"""P of the moving horizon observer is that of its error, though it uses measurements repeatedly."""

import casadi as ca
import numpy as np
import pytest
from scipy.stats import chi2

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import native, vm
from backsight.estimators import EKF, MHO, Noise, Prior
from backsight.estimators.base import AbstractEstimator
from backsight.models.lti import lti
from backsight.models.model import Model
from relations.linear import DT, GAUSSIANS, P0, A, C, Q, R, Run, model

N = 4


def influences(estimator: AbstractEstimator, of, mask) -> list[np.ndarray]:
    """How x_hat of every sample depends on all outputs, (nx, n ny) each: one run per output."""
    recursion = estimator.compile(of, of.dt)
    n, ny = mask.shape
    place = [c.name for c in recursion.channels].index("x_hat")

    def run(y):
        data = [np.zeros((n, of.nu)), y, mask]
        return vm.run(recursion, data, carry=recursion.carry0)[1][place]

    zero = run(np.zeros((n, ny)))
    columns = [run(y.reshape(n, ny)) - zero for y in np.eye(n * ny)]
    return list(np.stack(columns, axis=-1))


def error_covariances(gains, mask, *, A, C, Q, R, P0):
    """From the estimates' dependence on the data, and the data's on start and noise."""
    n, nx = len(mask), len(A)
    states = [np.hstack([np.eye(nx), np.zeros((nx, nx * (n - 1)))])]
    for k in range(n - 1):
        states.append(A @ states[-1])
        states[-1][:, nx * (k + 1) : nx * (k + 2)] = np.eye(nx)
    spread = np.kron(np.eye(n), Q)
    spread[:nx, :nx] = P0
    outputs = np.vstack([C @ x for x in states])
    noise = np.kron(np.eye(n), R)
    weight = 1 / np.where(mask > 0, mask, 1.0).ravel()
    noise *= np.outer(weight, weight)
    found = []
    for x, G in zip(states, gains, strict=True):
        by_motion = G @ outputs - x
        found.append(by_motion @ spread @ by_motion.T + G @ noise @ G.T)
    return found


def linear_problem(name):
    if name == "three states":
        return model(), GAUSSIANS, {"A": A, "C": C, "Q": Q, "R": R, "P0": P0}
    rng, n = np.random.default_rng(0), 14  # more states than straight-line code has
    system = {
        "A": np.linalg.qr(rng.standard_normal((n, n)))[0] * 0.98,
        "C": rng.standard_normal((1, n)),
        "Q": np.diag(rng.uniform(0, 0.1, n)),
        "R": np.array([[0.3]]),
        "P0": np.eye(n),
    }
    names = {f"x{i}": "" for i in range(n)}
    plant = lti(
        system["A"], np.zeros((n, 0)), system["C"],
        states=names, inputs={}, outputs={"y": ""}, dt=1.0,
    )  # fmt: skip
    prior = Prior(P0=system["P0"], x0=np.zeros(n))
    return plant, {"noise": Noise(R=system["R"], Q=system["Q"]), "prior": prior}, system


CASES = [
    *(("three states", horizon, alpha) for horizon in (1, N) for alpha in (1e-4, 1e-2, 1.0, 30.0)),
    ("many states", 2, 1.0),
]


@pytest.mark.parametrize(("name", "horizon", "alpha"), CASES)
def test_covariance_of_the_error(name, horizon, alpha):
    """With samples that are missing, and samples with a noise of their own."""
    of, gaussians, system = linear_problem(name)
    mask = np.ones((11, of.ny))
    mask[0] = mask[5, -1] = mask[7] = 0.0
    mask[8:10, 0] = 0.4
    observer = MHO(**gaussians, N=horizon, alpha=alpha)
    recursion = observer.compile(of, of.dt)
    data = [np.zeros((len(mask), of.nu)), np.zeros(mask.shape), mask]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    results = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    gains = influences(observer, of, mask)
    expected = error_covariances(gains, mask, **system)
    np.testing.assert_allclose(results["P"], expected, rtol=1e-8, atol=1e-9)


def test_bands_change_no_estimate():
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal((20, 2)), rng.standard_normal((20, 2))
    true, filters = (
        Run(MHO(**GAUSSIANS, N=N, bands=bands), model(), DT)(u, y) for bands in ("true", "filters")
    )
    np.testing.assert_array_equal(true["x_hat"], filters["x_hat"])
    assert np.all(np.linalg.eigvalsh(true["P"]) > 0)
    assert true["P"][-1, 0, 0] > 1.05 * filters["P"][-1, 0, 0]


@pytest.mark.parametrize("alpha", [1e-12, 0.0])
def test_without_weight_it_is_the_filter(alpha):
    u, y = np.ones((15, 2)), np.cos(np.arange(30.0)).reshape(15, 2)
    observer = Run(MHO(**GAUSSIANS, N=N, alpha=alpha), model(), DT)(u, y)
    kalman = Run(EKF(**GAUSSIANS), model(), DT)(u, y)
    np.testing.assert_allclose(observer["P"], kalman["P"], rtol=1e-9, atol=1e-12)


def pendulum() -> Model:
    return Model(
        f=lambda x, u, p: [x.w, -20 * ca.sin(x.a) - 0.3 * x.w + u.M],
        h=lambda x, u, p: [x.a],
        states={"a": "rad", "w": "rad/s"},
        inputs={"M": ""},
        outputs={"y": ""},
    )


def oscillator() -> Model:
    """Linear, with more states than outputs: two masses."""
    A = [[0, 1, 0, 0], [-40, -0.5, 20, 0], [0, 0, 0, 1], [20, 0, -20, -0.5]]
    B, C = [[0], [1], [0], [0]], [[1, 0, 0, 0]]
    states = dict.fromkeys(("a", "va", "b", "vb"), "")
    return lti(A, B, C, states=states, inputs={"M": ""}, outputs={"y": ""})


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [1e-4, 1e-2, 1.0])
@pytest.mark.parametrize(
    ("of", "sigma"), [(oscillator(), 0.02), (pendulum(), 0.02)], ids=["linear", "pendulum"]
)
def test_errors_are_as_large_as_their_bands(of, sigma, alpha):
    """NEES of many runs, at samples that lie apart, within the band of chi squared."""
    dt, n, runs, nx = 0.02, 160, 200, of.nx
    rng = np.random.default_rng(round(1e4 * alpha) + nx)
    walk = np.where(np.arange(nx) % 2, 0.05, 0.0)
    prior = Prior(x0=np.full(nx, 0.3), sigma_x0=[0.2, 0.5] * (nx // 2))
    noise = Noise(sigma_y=sigma, sigma_w=walk)
    steps = Integrator("rk4", 2)
    observer = MHO(noise, prior, N=10, alpha=alpha, integrator=steps)
    recursion = observer.compile(of, dt)
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", 1)
    after = steps.substep(of.rhs, x, ua=u, ub=u, h=dt / 2)
    after = steps.substep(of.rhs, after, ua=u, ub=u, h=dt / 2)
    move = ca.Function("move", [x, u], [after]).map(runs)
    torque = 3 * np.sin(7 * dt * np.arange(n))
    truth = [0.3 + rng.standard_normal((nx, runs)) * np.array([[0.2], [0.5]] * (nx // 2))]
    for M in torque[:-1]:
        ahead = np.asarray(move(truth[-1], np.full((1, runs), M)))
        truth.append(ahead + walk[:, None] * rng.standard_normal((nx, runs)))
    truth = np.array(truth)
    chosen, nees = np.arange(40, n, 30), []
    for k in range(runs):
        y = truth[:, :1, k] + sigma * rng.standard_normal((n, 1))
        data = [torque[:, None], y, np.ones((n, 1))]
        _, outputs = native.run(recursion, data, carry=recursion.carry0)
        found = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
        for t in chosen:
            e = found["x_hat"][t] - truth[t, :, k]
            nees.append(e @ np.linalg.solve(found["P"][t], e))
    low, high = chi2.ppf([0.0005, 0.9995], nx * len(nees)) / len(nees)
    assert low < np.mean(nees) < high
