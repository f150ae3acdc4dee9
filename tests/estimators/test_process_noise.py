"""Process noise of continuous models: Q is added per sample, Qc acts all the time."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import backsight as bs

DT = 0.1
A = np.array([[0.0, 1.0], [-400.0, -2.0]])
B, C = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
R = 1e-4
DENSITY = np.diag([0.0, 3.0])
OSCILLATOR = bs.lti(
    A, B, C, states={"q": "", "v": ""}, inputs={"u": ""}, outputs={"y": ""}, name="2 rad per sample"
)
PRIOR = bs.Prior(sigma_x0=[0.1, 1.0])
STEPS = bs.Integrator("rk4", 40)

METHODS = {
    "kf": lambda n: bs.KalmanFilter(n, PRIOR),
    "linear mhe": lambda n: bs.LinearMHE(n, PRIOR, N=4, arrival_weight=1.0),
    "ekf": lambda n: bs.EKF(n, PRIOR),
    "ekf, Runge-Kutta": lambda n: bs.EKF(n, PRIOR, STEPS),
    "ekf, ode": lambda n: bs.EKF(n, PRIOR, STEPS, covariance="ode"),
    "ekf, discrete": lambda n: bs.EKF(n, PRIOR, STEPS, covariance="discrete"),
    "iekf": lambda n: bs.IEKF(n, PRIOR),
    "ukf": lambda n: bs.UKF(n, PRIOR),
    "mho": lambda n: bs.MHO(n, PRIOR, N=3, alpha=0.0),
    "mhe": lambda n: bs.MHE(n, PRIOR, N=4),
    "mhe, ekf arrival": lambda n: bs.MHE(n, PRIOR, N=4, arrival=bs.settings.EKFArrival()),
    "mhe, ukf arrival": lambda n: bs.MHE(n, PRIOR, N=4, arrival=bs.settings.UKFArrival()),
}


def van_loan(density: np.ndarray) -> np.ndarray:
    """One exponential of the block matrix of Van Loan (1978)."""
    block = expm(np.block([[-A, density], [np.zeros((2, 2)), A.T]]) * DT)
    return block[2:, 2:].T @ block[:2, 2:]


def steady(Q: np.ndarray) -> np.ndarray:
    """Standard deviations after the measurement, by the algebraic Riccati equation."""
    P = solve_discrete_are(expm(A * DT).T, C.T, Q, np.array([[R]]))
    return np.sqrt(np.diag(P - P @ C.T @ C @ P / (P[0, 0] + R)))


def settled(estimator, model: bs.Model = OSCILLATOR) -> np.ndarray:
    n = 200
    recording = bs.from_arrays(
        u=np.zeros((n, 1)), y=np.zeros(n), inputs={"u": ""}, outputs={"y": ""}, dt=DT
    )
    return bs.estimate(estimator, model, recording, engine="vm")["x_std"].values[-1]


@pytest.mark.parametrize("method", METHODS)
def test_noise_per_sample(method):
    Q = np.diag([0.0, 1.0])
    expected = steady(Q)
    assert expected[1] == pytest.approx(1.022, abs=1e-3)
    for noise in (bs.Noise(R=[[R]], Q=Q), bs.Noise(R=[[R]], sigma_w={"v": 1.0})):
        assert settled(METHODS[method](noise)) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_noise_that_acts_all_the_time(method):
    noise = bs.Noise(R=[[R]], Qc=DENSITY)
    rough = {"ekf, Runge-Kutta": 1e-3, "ekf, ode": 1e-3}.get(method, 1e-6)
    expected = steady(van_loan(DENSITY))
    assert settled(METHODS[method](noise)) == pytest.approx(expected, rel=rough)


@pytest.mark.parametrize("given", [{"Q": np.diag([1e-3, 0.5])}, {"Qc": DENSITY}], ids=["Q", "Qc"])
def test_moving_horizon_estimation_is_the_kalman_filter(given):
    rng, n = np.random.default_rng(0), 40
    u, y = rng.standard_normal((n, 1)), 0.1 * rng.standard_normal(n)
    y[7:9] = np.nan
    recording = bs.from_arrays(u=u, y=y, inputs={"u": ""}, outputs={"y": ""}, dt=DT)
    noise = bs.Noise(R=[[R]], **given)
    kalman = bs.estimate(bs.KalmanFilter(noise, PRIOR), OSCILLATOR, recording, engine="vm")
    for name in ("mhe", "mhe, ekf arrival", "mhe, ukf arrival", "linear mhe"):
        result = bs.estimate(METHODS[name](noise), OSCILLATOR, recording, engine="vm")
        off = np.abs(result["x_hat"] - kalman["x_hat"]) / kalman["x_std"]
        assert off.max() < 1e-7, name
        assert result["P"].values == pytest.approx(kalman["P"].values, rel=1e-6, abs=1e-9), name


def test_the_certificate_of_a_continuous_model():
    rng = np.random.default_rng(0)
    recording = bs.from_arrays(
        u=rng.standard_normal((60, 1)), y=0.1 * rng.standard_normal(60),
        inputs={"u": ""}, outputs={"y": ""}, dt=DT,
    )  # fmt: skip
    for given in ({"Q": np.diag([1e-3, 0.5])}, {"Qc": DENSITY}):
        estimator = bs.MHE(bs.Noise(R=[[R]], **given), PRIOR, N=4)
        assert bs.check.certify(estimator, OSCILLATOR, recording).holds


def test_a_random_walk_of_a_kalman_bucy_filter_is_spread_over_the_period():
    """Per sample or as a density, the same."""
    per_sample = bs.Noise(R=[[R]], Q=DT * DENSITY)
    density = bs.Noise(R=[[R]], Qc=DENSITY)
    a, b = (
        settled(bs.EKF(n, PRIOR, STEPS, measurement="continuous")) for n in (per_sample, density)
    )
    assert a == pytest.approx(b, rel=1e-12)


@pytest.mark.parametrize("form", ["Q", "Qc"])
def test_the_high_gain_observer(form):
    """What is not measured any more spreads as Q says, with small steps as Qc says."""
    model = bs.Model(
        f=lambda x, u, p: [x.v, -1e-9 * x.q], h=lambda x, u, p: [x.q], states={"q": "", "v": ""},
        outputs={"y": ""},
    )  # fmt: skip
    jump = np.diag([0, 4.0])
    given = {"Q": jump} if form == "Q" else {"Qc": jump / DT}
    made = bs.HGO(bs.Noise(R=[[R]], **given), bs.Prior(P0=np.zeros((2, 2))), gain=2.0)
    recording = bs.from_arrays(y=np.full(4, np.nan), outputs={"y": ""}, inputs={}, dt=DT)
    P = bs.estimate(made, model, recording, engine="vm")["P"].values[-1]
    F, expected = np.array([[1, DT], [0, 1]]), np.zeros((2, 2))
    for _ in range(3):
        expected = F @ expected @ F.T + np.diag([0, 4.0])
    assert P[1, 1] == pytest.approx(expected[1, 1])
    assert pytest.approx(expected if form == "Q" else P) == P
