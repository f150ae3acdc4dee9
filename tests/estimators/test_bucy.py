import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are

from backsight.discrete.runge_kutta import Integrator
from backsight.engine import vm
from backsight.errors import TuningError
from backsight.estimators import EKF, Noise, Prior
from backsight.models.builtin import duffing, sdof
from backsight.models.model import Model
from relations.linear import Run

DT, N = 0.05, 61
R = 1e-3
QC = np.diag([0.0, 0.5])
X0, P0 = np.array([0.1, -0.2]), np.diag([0.01, 0.3])
LINEAR, CUBIC = sdof(k=100.0, b=1.0), duffing(k1=60.0, d=1.0, k3=400.0)


def inputs():
    rng = np.random.default_rng(0)
    u = np.repeat(5 * rng.standard_normal(N // 9 + 1), 9)[:N]
    return u, np.cumsum(0.02 * rng.standard_normal(N))


def run(substeps: int, model: Model = LINEAR, mask=None, **settings):
    u, y = inputs()
    mask = np.ones(N) if mask is None else mask
    estimator = EKF(
        Noise(R=[[R]], Qc=QC),
        Prior(x0=X0, P0=P0),
        integrator=Integrator("rk4", substeps),
        measurement="continuous",
        **settings,
    )
    recursion = estimator.compile(model, DT)
    data = [u[:, None], np.where(mask, y, 7.0)[:, None], mask[:, None]]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    return outputs[0], recursion.channels[1].unpack(outputs[1]), outputs


def riccati(cubic: float, stiffness: float):
    """Equations 13-14 by an adaptive solver, with the measurement joined by lines."""
    u, y = inputs()

    def rhs(t, z):
        k = min(int(t / DT + 1e-9), N - 2)
        measured = y[k] + (t / DT - k) * (y[k + 1] - y[k])
        x, P = z[:2], z[2:].reshape(2, 2)
        K = P[:, 0] / (R * DT)
        F = np.array([[0.0, 1.0], [-stiffness - 3 * cubic * x[0] ** 2, -1.0]])
        dx = [x[1], -stiffness * x[0] - cubic * x[0] ** 3 - x[1] + u[k]]
        dP = F @ P + P @ F.T - np.outer(K, P[0]) + QC
        return np.concatenate([dx + K * (measured - x[0]), dP.ravel()])

    z = np.concatenate([X0, P0.ravel()])
    states = [z]
    for k in range(N - 1):
        z = solve_ivp(rhs, (k * DT, (k + 1) * DT * (1 - 1e-12)), z, rtol=1e-9, atol=1e-12).y[:, -1]
        states.append(z)
    return np.array(states)


@pytest.mark.parametrize(
    ("model", "cubic", "stiffness"), [(LINEAR, 0.0, 100.0), (CUBIC, 400.0, 60.0)]
)
def test_it_converges_to_equations_13_and_14(model, cubic, stiffness):
    """First order: four times the sub-steps, a quarter of the error."""
    expected = riccati(cubic, stiffness)
    errors = []
    for substeps in (16, 64):
        x, P, _ = run(substeps, model)
        found = np.hstack([x, P.reshape(N, 4)])
        errors.append(np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0))
    assert errors[1].max() < 0.02
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.15)


def test_stationary_covariance():
    A, H = np.array([[0.0, 1.0], [-100.0, -1.0]]), np.array([[1.0, 0.0]])
    expected = solve_continuous_are(A.T, H.T, QC, [[R * DT]])
    _, P, _ = run(64)
    np.testing.assert_allclose(P[-1], expected, rtol=5e-3, atol=5e-3 * expected[0, 1])


def test_small_noise_is_no_trouble():
    """The filter is a thousand times faster than the sub-steps, and P stays positive."""
    u, y = inputs()
    estimator = EKF(Noise(R=[[1e-14]], Qc=QC), Prior(x0=X0, P0=P0), measurement="continuous")
    recursion = estimator.compile(LINEAR, DT)
    _, outputs = vm.run(
        recursion, [u[:, None], y[:, None], np.ones((N, 1))], carry=recursion.carry0
    )
    P = recursion.channels[1].unpack(outputs[1])
    assert np.linalg.eigvalsh(P).min() > 0
    np.testing.assert_allclose(outputs[0][1:, 0], y[1:], atol=1e-6)
    assert not outputs[5].any()


def test_gaps_weigh_nothing_and_single_samples_weigh_one():
    """The sub-steps after a gap are those of the sampled filter, and a gap is prediction."""
    mask = np.ones(N)
    mask[20:30] = 0.0
    x, P, outputs = run(8, mask=mask)
    np.testing.assert_array_equal(outputs[3][20:30], 0.0)
    assert (np.diff(P[19:30, 0, 0]) > 0).all()
    before, after = P[29], P[30]
    h, A = DT / 8, np.array([[0.0, 1.0], [-100.0, -1.0]])
    for _ in range(8):
        step = np.eye(2)
        for order in range(4, 0, -1):
            step = np.eye(2) + h / order * A @ step
        before = step @ (before + h / 2 * QC) @ step.T + h / 2 * QC
    gain = before[:, 0] / (before[0, 0] + R)
    np.testing.assert_allclose(after, before - np.outer(gain, before[0]), rtol=1e-9, atol=1e-15)
    assert np.isfinite(x).all()


def test_interpolated_inputs():
    """With a ramp of the input the prediction between samples follows it."""
    mask = np.zeros(N)
    u, _ = inputs()
    settings = {"noise": Noise(R=[[R]], Qc=QC), "prior": Prior(x0=X0, P0=P0)}
    ramp = Integrator("rk4", 4, "foh")
    both = []
    for measurement in ("continuous", "sampled"):
        recursion = EKF(**settings, integrator=ramp, measurement=measurement).compile(LINEAR, DT)
        data = [u[:, None], np.zeros((N, 1)), mask[:, None]]
        both.append(vm.run(recursion, data, carry=recursion.carry0)[1][0])
    np.testing.assert_allclose(both[0], both[1], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("settings", "model", "message"),
    [
        ({"measurement": "continous"}, LINEAR, "unknown measurement 'continous'"),
        ({"measurement": "continuous", "covariance": "ode"}, LINEAR, "covariance='transition'"),
        (
            {"measurement": "continuous"},
            Model(f=lambda x, u, p: [x.a], h=lambda x, u, p: [x.a], states={"a": ""},
                  outputs={"y": ""}, dt=DT),
            "continuous-time model",
        ),
    ],
)  # fmt: skip
def test_wrong_settings(settings, model, message):
    with pytest.raises(TuningError, match=message):
        EKF(Noise(sigma_y=1.0), Prior(sigma_x0=1.0), **settings).compile(model, DT)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_a_held_input_that_jumps_through_to_the_output(nonlinear):
    """An accelerometer under a square wave, exact data and start: nothing is there to correct."""
    w, d, dt, n = 2 * np.pi * 3, 0.05, 0.02, 60
    A, B = np.array([[0, 1], [-(w**2), -2 * d * w]]), np.array([0.0, 1.0])
    M = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * dt)
    u, x, states, y = np.where(np.arange(n) % 10 < 5, 5.0, -5.0), np.zeros(2), [], []
    for k in range(n):
        states.append(x)
        y.append(A[1] @ x + u[k])
        x = M[:2, :2] @ x + M[:2, 2] * u[k]

    def acceleration(x, u):
        rate = u.F - w**2 * x.q - 2 * d * w * x.v
        return 10 * ca.tanh(rate / 10) if nonlinear else rate

    model = Model(
        f=lambda x, u, p: [x.v, u.F - w**2 * x.q - 2 * d * w * x.v],
        h=lambda x, u, p: [acceleration(x, u)],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"a": "m/s2"},
    )
    measured = 10 * np.tanh(np.array(y) / 10) if nonlinear else np.array(y)
    noise, prior = Noise(sigma_y=0.1, Qc=np.diag([0, 0.5])), Prior(sigma_x0=[0.01, 0.1])
    off = {}
    for steps in (8, 64):
        filter_ = EKF(noise, prior, Integrator("rk4", steps), measurement="continuous")
        result = Run(filter_, model, dt)(u[:, None], measured[:, None])
        deviation = np.sqrt(np.diagonal(result["P"], axis1=1, axis2=2))
        off[steps] = np.abs((result["x_hat"] - np.array(states)) / deviation).max()
    assert off[8] < 4
    assert off[64] < 4
