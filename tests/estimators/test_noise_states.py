"""Noise of inputs, of parameters, and common to process and sensors, against filters in NumPy."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import backsight as bs
from backsight.errors import ModelError, TuningError

DT, N = 0.01, 80
K, C = 400.0, 2.0
M = expm(DT * np.array([[0.0, 1, 0], [-K, -C, 1], [0, 0, 0]]))
A, B = M[:2, :2], M[:2, 2:]
H, D = np.array([[-K, -C], [1.0, 0.0]]), np.array([[1.0], [0.0]])
R = np.diag([0.04, 1e-6])
PRIOR = bs.Prior(P0=np.diag([1e-4, 1e-2]))


def structure(dt: float | None = DT) -> bs.Model:
    """A mass on a spring; its acceleration and its displacement are measured."""
    of_time = ([[0.0, 1], [-K, -C]], [[0.0], [1]]) if dt is None else (A, B)
    return bs.lti(
        *of_time,
        H,
        D,
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"a": "m/s2", "y": "m"},
        dt=dt,
    )


def recording(u, y, *, inputs=("F",), outputs=("a", "y")):
    units = {"inputs": dict.fromkeys(inputs, ""), "outputs": dict.fromkeys(outputs, "")}
    return bs.from_arrays(u=u, y=y, dt=DT, **units)


def data(seed: int = 0):
    rng = np.random.default_rng(seed)
    u = 3 * np.sin(2 * np.pi * 2 * DT * np.arange(N)) + rng.standard_normal(N)
    y = rng.standard_normal((N, 2)) * [0.5, 1e-2]
    y[20:25] = np.nan
    y[::7, 0] = np.nan
    return u, y


def dense(u, y, *, Q, R, S):
    """Kalman filter whose w and v have the covariance S; Q may be a function of the sample."""
    x, P, found = np.zeros(2), np.diag([1e-4, 1e-2]), []
    for k in range(len(u)):
        Qk = Q(k) if callable(Q) else Q
        seen = np.isfinite(y[k])
        Hk, Rk, Sk = H[seen], R[np.ix_(seen, seen)], S[:, seen]
        V = np.linalg.inv(Hk @ P @ Hk.T + Rk)
        e = (y[k] - H @ x - D[:, 0] * u[k])[seen]
        found.append((x + P @ Hk.T @ V @ e, P - P @ Hk.T @ V @ Hk @ P))
        L = (A @ P @ Hk.T + Sk) @ V
        x = A @ x + B[:, 0] * u[k] + L @ e
        P = A @ P @ A.T + Qk - L @ np.linalg.inv(V) @ L.T
    return (np.array(k) for k in zip(*found, strict=True))


ESTIMATORS = {
    "kf": lambda n, p=PRIOR: bs.KalmanFilter(n, p),
    "ekf": lambda n, p=PRIOR: bs.EKF(n, p),
    "iekf": lambda n, p=PRIOR: bs.IEKF(n, p),
    "ukf": lambda n, p=PRIOR: bs.UKF(n, p),
    "mho": lambda n, p=PRIOR: bs.MHO(n, p, N=4, alpha=1e-9),
    "mhe": lambda n, p=PRIOR: bs.MHE(n, p, N=4),
    "lmhe": lambda n, p=PRIOR: bs.LinearMHE(n, p, N=4, arrival_weight=1.0),
}


def agrees(result, x, P, tolerance=1e-9):
    deviation = np.sqrt(np.einsum("kii->ki", P))
    assert result["x_hat"].shape == x.shape
    assert np.max(np.abs(result["x_hat"].values - x) / deviation) < tolerance
    scale = deviation[:, :, None] * deviation[:, None, :]
    assert np.max(np.abs(result["P"].values - P) / scale) < tolerance


@pytest.mark.parametrize("key", ESTIMATORS)
def test_noise_of_an_input_with_feedthrough(key):
    u, y = data()
    noise = bs.Noise(R=R, sigma_w={"v": 1e-3}, sigma_u={"F": 0.7})
    result = bs.estimate(ESTIMATORS[key](noise), structure(), recording(u, y), engine="vm")
    Q = 0.49 * B @ B.T + np.diag([0, 1e-6])
    x, P = dense(u, y, Q=Q, R=R + 0.49 * D @ D.T, S=0.49 * B @ D.T)
    agrees(result, x, P, 1e-6 if key == "mho" else 1e-9)


@pytest.mark.parametrize("key", ESTIMATORS)
def test_noise_common_to_process_and_sensors(key):
    u, y = data(1)
    Q, S = B @ B.T + np.diag([1e-10, 1e-6]), B @ np.array([[0.15, 1e-5]])
    noise = bs.Noise(R=R, Q=Q, cross=S)
    result = bs.estimate(ESTIMATORS[key](noise), structure(), recording(u, y), engine="vm")
    agrees(result, *dense(u, y, Q=Q, R=R, S=S), 1e-6 if key == "mho" else 1e-8)


@pytest.mark.parametrize("key", ["kf", "ekf", "ukf", "mhe"])
def test_a_continuous_model_with_held_inputs(key):
    u, y = data(2)
    noise = bs.Noise(R=R, sigma_w={"v": 1e-3}, sigma_u=0.7)
    estimator = ESTIMATORS[key](noise)
    if key != "kf":
        fine = bs.Integrator("dopri5", 4)
        estimator = dataclasses.replace(estimator, integrator=fine)
    result = bs.estimate(estimator, structure(dt=None), recording(u, y), engine="vm")
    Q = 0.49 * B @ B.T + np.diag([0, 1e-6])
    x, P = dense(u, y, Q=Q, R=R + 0.49 * D @ D.T, S=0.49 * B @ D.T)
    agrees(result, x, P, 1e-6)


def test_process_noise_that_changes_from_sample_to_sample():
    """A parameter that is noise, times a recorded input."""
    u, y = data(3)
    rough = 0.1 + (np.arange(N) > 40) * 2.0
    model = bs.Model(
        f=lambda x, u, p: [
            A[0, 0] * x.q + A[0, 1] * x.v + B[0, 0] * (u.F + u.s * p.w),
            A[1, 0] * x.q + A[1, 1] * x.v + B[1, 0] * (u.F + u.s * p.w),
        ],
        h=lambda x, u, p: [-K * x.q - C * x.v + u.F, x.q],
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N", "s": ""},
        outputs={"a": "m/s2", "y": "m"},
        parameters={"w": 0.0},
        dt=DT,
    )
    noise = bs.Noise(R=R, sigma_p={"w": 0.5})
    rec = recording(np.column_stack([u, rough]), y, inputs=("F", "s"))
    x, P = dense(u, y, Q=lambda k: 0.25 * rough[k] ** 2 * B @ B.T, R=R, S=np.zeros((2, 2)))
    for key in ("ekf", "ukf", "mhe"):
        agrees(bs.estimate(ESTIMATORS[key](noise), model, rec, engine="vm"), x, P, 1e-8)


def test_noise_that_is_not_additive_enters_by_its_derivatives():
    """Gain noise of a sensor and noise inside f: an EKF with L W L', R + M W M' and L W M'."""
    model = bs.Model(
        f=lambda x, u, p: [0.9 * x.a + 0.1 * ca.sin(x.a) * (1 + p.w) + 0.1 * u.F],
        h=lambda x, u, p: [(1 + p.g) * x.a**2 + 0.3 * p.w],
        states={"a": ""},
        inputs={"F": ""},
        outputs={"y": ""},
        parameters={"w": 0.0, "g": 0.0},
        dt=DT,
    )
    rng = np.random.default_rng(4)
    u, y = rng.standard_normal(N), 1 + 0.3 * rng.standard_normal(N)
    W, R1, x, P, expected = np.diag([0.04, 0.01]), 0.01, 1.0, 0.04, []
    for k in range(N):
        h, e = 2 * x, y[k] - x**2
        M, s = np.array([0.3, x**2]), np.sin(x)
        S = h * P * h + M @ W @ M + R1
        # Of the state with its noise: what the sample says of both.
        joint = np.block([[np.array([[P]]), np.zeros((1, 2))], [np.zeros((2, 1)), W]])
        row = np.concatenate([[h], M])
        gain = joint @ row / S
        post = np.concatenate([[x], [0.0, 0.0]]) + gain * e
        joint = joint - np.outer(gain, gain) * S
        expected.append([post[0], joint[0, 0]])
        a, w = post[0], post[1]
        s = np.sin(a)
        F = np.array([0.9 + 0.1 * np.cos(a) * (1 + w), 0.1 * s, 0.0])
        x, P = 0.9 * a + 0.1 * s * (1 + w) + 0.1 * u[k], F @ joint @ F
    noise = bs.Noise(sigma_y=0.1, sigma_p={"w": 0.2, "g": 0.1})
    prior = bs.Prior(sigma_x0=0.2, x0={"a": 1.0})
    result = bs.estimate(bs.EKF(noise, prior), model, recording(u, y, outputs=["y"]), engine="vm")
    x, P = np.array(expected).T
    agrees(result, x[:, None], P[:, None, None])


def test_an_inertia_is_right_within_its_band():
    """Torque measured with noise: as an exact input it makes the inertia wrong by far."""
    n, J, b, gain = 800, 1.14e-3, 3e-3, 0.062
    t = DT / 10 * np.arange(n)
    i = 1.2 * np.sign(np.sin(2 * np.pi * 5.3 * t)) + 0.8 * np.sin(2 * np.pi * (8 * t + 8 * t**2))
    decay, x, angle = np.exp(-b / J * DT / 10), np.zeros(2), []
    for k in range(n):
        angle.append(x[0])
        r = gain * i[k] / b
        w = r + (x[1] - r) * decay
        x = np.array([x[0] + r * DT / 10 + (x[1] - r) * (1 - decay) * J / b, w])
    rng = np.random.default_rng(5)
    rec = bs.from_arrays(
        u=i + 0.3 * rng.standard_normal(n),
        y=np.array(angle) + 1e-4 * rng.standard_normal(n),
        dt=DT / 10,
        inputs={"i": "A"},
        outputs={"y": "rad"},
    )
    motor = bs.augment(
        bs.Model(
            f=lambda x, u, p: [x.w, (gain * u.i - p.b * x.w) / p.J],
            h=lambda x, u, p: [x.phi],
            states={"phi": "rad", "w": "rad/s"},
            inputs={"i": "A"},
            outputs={"y": "rad"},
            parameters={"J": 1e-3, "b": 2e-3},
        ),
        ["J", "b"],
    )
    prior = bs.Prior(sigma_x0={"phi": 1e-3, "w": 0.1, "J": 2e-4, "b": 1e-3})
    off, told = {}, {}
    for name, sigma_u in (("exact", None), ("noisy", {"i": 0.3})):
        noise = bs.Noise(sigma_y=1e-4, sigma_w={"w": 1e-5}, sigma_u=sigma_u)
        found = bs.compare({"EKF": bs.EKF(noise, prior)}, motor, rec, engine="vm")
        told[name], last = found.verdicts()[-1], found["EKF"].isel(time=-1)
        J_hat = last.sel(state="J")
        off[name] = abs(float((J_hat["x_hat"] - J) / J_hat["x_std"]))
    assert off["noisy"] < 3
    assert off["exact"] > 30
    assert "over-confident" in told["exact"]
    assert "consistent, its innovations are as large" in told["noisy"]


@pytest.mark.parametrize("engine", ["vm", "native"])
def test_outliers_and_windows_go_with_it(engine):
    u, y = data(6)
    y[50, 1] = 3.0
    noise = bs.Noise(
        R=R, sigma_w={"v": 1e-2}, sigma_u=0.7, outliers=bs.settings.Gate(probability=1 - 1e-9)
    )
    estimator = bs.MHE(noise, PRIOR, N=4)
    rec = recording(u, y)
    result = bs.estimate(estimator, structure(), rec, engine=engine)
    assert result["weight"][50, 1] == 0
    window = bs.solve_window(estimator, structure(), rec, at=60)
    assert window["x"].shape == (5, 2)
    assert np.allclose(window["x"][-1], result["x_hat"][60], atol=1e-9)


def test_what_a_start_of_the_window_is_has_the_states_of_the_model():
    u, y = data()
    noise = bs.Noise(R=R, sigma_u=0.7)
    result = bs.estimate(bs.MHO(noise, PRIOR, N=4), structure(), recording(u, y), engine="vm")
    assert result["x_start"].shape == (N, 2)
    assert result["P_start"].shape == (N, 2, 2)


NOISY = bs.Noise(R=R, sigma_u=0.7)
RAMP = bs.Integrator(hold="foh")


@pytest.mark.parametrize(
    ("estimator", "dt", "message"),
    [
        (bs.Luenberger(NOISY, PRIOR, poles=(0.5, 0.6)), DT, "cannot take sigma_u of the noise"),
        (bs.RecursiveMHE(NOISY, PRIOR, N=4), DT, "cannot take sigma_u"),
        (bs.JointInput(NOISY, PRIOR, forces=("F",)), DT, "cannot take sigma_u"),
        (bs.EKF(NOISY, PRIOR, integrator=RAMP), None, "needs inputs that are held"),
        (bs.EKF(NOISY, PRIOR, measurement="continuous"), None, "measurement = 'sampled' only"),
        (bs.EKF(dataclasses.replace(NOISY, Qc=np.eye(2)), PRIOR), None, "instead of Qc"),
        (bs.EKF(dataclasses.replace(NOISY, sigma_u={"G": 1}), PRIOR), DT, "sigma_u names 'G'"),
        (bs.EKF(bs.Noise(R=R, sigma_p={"k": 1.0}), PRIOR), DT, "sigma_p names 'k'"),
        (bs.EKF(bs.Noise(R=R, Q=np.eye(2), cross=np.eye(3)), PRIOR), DT, "cross has the shape"),
        (
            bs.EKF(bs.Noise(R=R, Q=np.eye(2), cross=np.eye(2)), PRIOR),
            DT,
            "not positive semidefinite",
        ),
        (
            bs.EKF(bs.Noise(R=np.eye(2), Q=np.eye(2), cross=np.diag([1.0, 0.5])), PRIOR),
            DT,
            "none of its own",
        ),
    ],
)
def test_what_cannot_take_it_says_so(estimator, dt, message):
    with pytest.raises((TuningError, ModelError), match=message):
        estimator.compile(structure(dt), DT)


@pytest.mark.slow
@pytest.mark.parametrize("key", ["ekf", "ukf", "mhe"])
def test_bands_hold_with_noisy_inputs(key):
    """NEES of 60 simulated recordings with noise in the input, its feedthrough, and the sensors."""
    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = 3 * np.sin(2 * np.pi * 2 * DT * np.arange(N))
        felt, x, states, y = u + 0.7 * rng.standard_normal(N), np.array([0.01, 0.1]), [], []
        x = x * rng.standard_normal(2)
        for k in range(N):
            states.append(x)
            y.append(H @ x + D[:, 0] * felt[k] + rng.standard_normal(2) * np.sqrt(np.diag(R)))
            x = A @ x + B[:, 0] * felt[k]
        noise = bs.Noise(R=R, sigma_u=0.7)
        result = bs.estimate(ESTIMATORS[key](noise), structure(), recording(u, np.array(y)))
        error = (result["x_hat"].values - np.array(states))[5:]
        found.append(np.einsum("ki,kij,kj->k", error, np.linalg.inv(result["P"][5:]), error))
    assert 1.8 < np.mean(found) < 2.2
