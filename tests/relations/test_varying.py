"""Models whose matrices change with known inputs, against filters written out in NumPy."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm

from backsight.discrete.noise import discretise_noise
from backsight.discrete.runge_kutta import Integrator
from backsight.discrete.varying import transitions
from backsight.errors import ModelError, TuningError
from backsight.estimators import EKF, JointInput, KalmanFilter, LinearMHE, Noise, Prior
from backsight.models.lti import bent
from backsight.models.model import Model
from backsight.models.signals import Signal
from closeness import assert_close
from relations.linear import Run

DT, W, K, C = 0.01, 20.0, 900.0, 2.0
QC = np.diag([0.0, 0.1, 0.2, 0.3])
PRIOR = Prior(sigma_x0=[1e-2, 0.3, 2.0, 2.0])
TIMES = DT * np.arange(60)[:, None]


def unbalance(upper: float = np.inf) -> Model:
    """A rotor with an unbalance of unknown size and angle; the time is an input."""
    return Model(
        f=lambda x, u, p: [
            x.v,
            -K * x.q - C * x.v + x.a * ca.cos(W * u.t) - x.b * ca.sin(W * u.t),
            0,
            0,
        ],
        h=lambda x, u, p: [x.q, x.v + x.a * u.t],
        states={"q": "m", "v": Signal("m/s", upper=upper), "a": "", "b": ""},
        inputs={"t": "s"},
        outputs={"y": "m", "w": "m/s"},
    )


def matrices(t: float) -> tuple[np.ndarray, np.ndarray]:
    A = np.zeros((4, 4))
    A[0, 1], A[1] = 1.0, [-K, -C, np.cos(W * t), -np.sin(W * t)]
    return A, np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, t, 0.0]])


def outputs(seed: int) -> np.ndarray:
    y = np.random.default_rng(seed).standard_normal((len(TIMES), 2)) * [0.02, 0.3]
    y[7, 0] = y[9] = np.nan
    return y


def filtered(y, *, R, P0, steps, C_of):
    """The textbook's filter with matrices of every sample: means and covariances."""
    x, P = np.zeros(len(P0)), P0
    means, covariances = [], []
    for k, measured in enumerate(y):
        rows = np.isfinite(measured)
        H, V = C_of(k)[rows], R[np.ix_(rows, rows)]
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + V)
        x, P = x + gain @ (measured[rows] - H @ x), P - gain @ H @ P
        means.append(x)
        covariances.append(P)
        A, b, Q = steps(k)
        x, P = A @ x + b, A @ P @ A.T + Q
    return np.array(means), np.array(covariances)


def over_a_sample(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    A, Q = discretise_noise(matrices(TIMES[k, 0])[0], QC, dt=DT)
    return A, np.zeros(4), Q


def test_held_coefficients_are_exact():
    y, R = outputs(1), np.diag([1e-4, 1e-2])
    result = Run(KalmanFilter(Noise(R=R, Qc=QC), PRIOR), unbalance(), DT)(TIMES, y)
    x, P = filtered(
        y, R=R, P0=PRIOR.covariance(unbalance()), steps=over_a_sample,
        C_of=lambda k: matrices(TIMES[k, 0])[1],
    )  # fmt: skip
    assert_close(result["x_hat"], x, 1e-10)
    assert_close(result["P"], P, 1e-10)


def test_a_stiff_matrix_takes_more_doublings():
    """Eigenvalues from -1e5 to -1e-3 per second over a sample of 0.1 s, in unlike units."""
    model = Model(
        f=lambda x, u, p: [-1e5 * x.fast + 1e9 * u.g * x.slow, -1e-3 * x.slow],
        h=lambda x, u, p: [x.fast], states={"fast": "", "slow": ""}, inputs={"g": ""},
        outputs={"y": ""},
    )  # fmt: skip
    Qc = np.diag([1e4, 1e-6])
    A, _, Q = (np.array(k) for k in transitions(model, Qc, dt=0.1, ramp=False)(0.7, 0.0))
    Phi, V = discretise_noise(np.array([[-1e5, 0.7e9], [0.0, -1e-3]]), Qc, dt=0.1)
    size = np.sqrt(np.outer(V.diagonal(), V.diagonal()))
    np.testing.assert_allclose(Q / size, V / size, atol=1e-9)
    np.testing.assert_allclose(A, Phi, rtol=1e-9, atol=1e-9)


def test_interpolated_coefficients_solve_the_differential_equation():
    def rates(s, z):
        A = matrices(0.3 + s)[0]
        Phi, Q = z[:16].reshape(4, 4), z[16:].reshape(4, 4)
        return np.concatenate([(A @ Phi).ravel(), (A @ Q + Q @ A.T + QC).ravel()])

    start = np.concatenate([np.eye(4).ravel(), np.zeros(16)])
    end = solve_ivp(rates, (0, DT), start, rtol=1e-11, atol=1e-14).y[:, -1]
    A, _, Q = (np.array(k) for k in transitions(unbalance(), QC, dt=DT, ramp=True)(0.3, 0.3 + DT))
    np.testing.assert_allclose(A, end[:16].reshape(4, 4), atol=1e-9)
    np.testing.assert_allclose(Q, end[16:].reshape(4, 4), atol=1e-5 * Q.max())


@pytest.mark.parametrize("smooth", [False, True])
def test_the_extended_filter_with_short_steps_agrees(smooth):
    noise = Noise(sigma_y=[1e-2, 0.1], sigma_w=[0, 1e-3, 1e-2, 1e-2])
    exact = KalmanFilter(noise, PRIOR, hold="foh")
    fine = EKF(noise, PRIOR, integrator=Integrator("dopri5", substeps=6, hold="foh"))
    for e in (exact, fine):
        assert e.input_hold == "foh"
    if smooth:
        rows = [outputs(2), TIMES]
        a, b = (smoothed(e, *rows) for e in (exact, fine))
        np.testing.assert_allclose(a, b, atol=1e-6 * np.abs(b).max())
        return
    a, b = (Run(e, unbalance(), DT)(TIMES, outputs(2)) for e in (exact, fine))
    np.testing.assert_allclose(a["x_hat"], b["x_hat"], atol=1e-7 * np.abs(b["x_hat"]).max())
    np.testing.assert_allclose(a["P"], b["P"], atol=1e-7 * np.abs(b["P"]).max())


def smoothed(estimator, y, times):
    from backsight.data import from_arrays
    from backsight.run.estimation import smooth

    recording = from_arrays(
        u=times, y=y, dt=DT, inputs={"t": "s"}, outputs={"y": "m", "w": "m/s"}
    )  # fmt: skip
    return smooth(estimator, unbalance(), recording, engine="vm").x_hat.values


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_window_with_arrival_cost_is_the_filter(hold):
    noise = Noise(sigma_y=[1e-2, 0.1], Qc=QC)
    y = outputs(3)[:25]
    a, b = (
        Run(e, unbalance(), DT)(TIMES[:25], y)
        for e in (
            KalmanFilter(noise, PRIOR, hold=hold),
            LinearMHE(noise, PRIOR, N=6, arrival_weight=1.0, hold=hold),
        )
    )
    for name in ("x_hat", "P", "e", "S"):
        assert_close(a[name], b[name], 1e-9)


def test_a_window_without_arrival_cost_is_least_squares():
    y, N = outputs(4)[:25], 8
    noise = Noise(sigma_y=[1e-2, 0.1])
    result = Run(LinearMHE(noise, PRIOR, N=N), unbalance(), DT)(TIMES[:25], y)
    rows, values, Phi = [], [], np.eye(4)
    for k in range(24 - N, 25):
        seen = np.isfinite(y[k])
        weights = np.array([1e-2, 0.1])[seen]
        rows.append((matrices(TIMES[k, 0])[1] @ Phi)[seen] / weights[:, None])
        values.append(y[k][seen] / weights)
        if k < 24:
            Phi = expm(matrices(TIMES[k, 0])[0] * DT) @ Phi
    H = np.vstack(rows)
    first = np.linalg.lstsq(H, np.concatenate(values), rcond=None)[0]
    assert_close(result["x_hat"][-1], Phi @ first, 1e-8)
    assert_close(result["P"][-1], Phi @ np.linalg.inv(H.T @ H) @ Phi.T, 1e-8)


def test_discrete_models_and_constant_terms():
    """A load times a recorded position, and a weight that nobody writes as an input."""
    model = Model(
        f=lambda x, u, p: [0.9 * x.s + u.pos * x.load - 0.5, x.load],
        h=lambda x, u, p: [x.s * (2 - u.pos) + u.pos**2],
        states={"s": "", "load": "N"}, inputs={"pos": "m"}, outputs={"y": ""}, dt=1.0,
    )  # fmt: skip
    rng = np.random.default_rng(5)
    u, y = rng.random((30, 1)), rng.standard_normal((30, 1))
    Q = np.diag([1e-2, 1e-4])
    result = Run(KalmanFilter(Noise(sigma_y=0.1, Q=Q), Prior(1.0)), model, 1.0)(u, y)
    x, P = filtered(
        y - u**2, R=np.eye(1) * 1e-2, P0=np.eye(2),
        C_of=lambda k: np.array([[2 - u[k, 0], 0.0]]),
        steps=lambda k: (np.array([[0.9, u[k, 0]], [0, 1]]), np.array([-0.5, 0]), Q),
    )  # fmt: skip
    assert_close(result["x_hat"], x, 1e-12)
    assert_close(result["P"], P, 1e-12)


def test_constant_matrices_with_a_curved_input_are_in_closed_form():
    model = Model(
        f=lambda x, u, p: [x.v, -K * x.q - C * x.v + ca.tanh(u.t) - 9.81],
        h=lambda x, u, p: [x.q], states={"q": "", "v": ""}, inputs={"t": ""}, outputs={"y": ""},
    )  # fmt: skip
    A, b, Q = (np.array(k) for k in transitions(model, QC[:2, :2], dt=DT, ramp=False)(0.4, 0.0))
    block = np.zeros((3, 3))
    block[:2] = [[0, 1, 0], [-K, -C, np.tanh(0.4) - 9.81]]
    whole = expm(block * DT)
    np.testing.assert_allclose(np.hstack([A, b]), whole[:2], atol=1e-14)
    np.testing.assert_allclose(Q, discretise_noise(block[:2, :2], QC[:2, :2], dt=DT)[1])


def test_many_states_are_as_many_models():
    n = 4
    names = [f"{k}{i}" for i in range(n) for k in "qvab"]

    def f(x, u, p):
        return [row for i in range(n) for row in (
            x[f"v{i}"],
            -K * x[f"q{i}"] - C * x[f"v{i}"] + x[f"a{i}"] * ca.cos(W * u.t)
            - x[f"b{i}"] * ca.sin(W * u.t), 0, 0)]  # fmt: skip

    many = Model(
        f=f, h=lambda x, u, p: [x[f"q{i}"] for i in range(n)], states=dict.fromkeys(names, ""),
        inputs={"t": "s"}, outputs={f"y{i}": "" for i in range(n)},
    )  # fmt: skip
    y = np.random.default_rng(6).standard_normal((12, n)) * 0.02
    e = KalmanFilter(
        Noise(sigma_y=1e-2, Qc=block_diag(*[QC] * n)),
        Prior(sigma_x0=[1e-2, 0.3, 2.0, 2.0] * n), hold="foh",
    )  # fmt: skip
    result = Run(e, many, DT)(TIMES[:12], y)
    wide = np.full((12, 2), np.nan)
    wide[:, 0] = y[:, 1]
    one = Run(
        KalmanFilter(Noise(sigma_y=[1e-2, 1.0], Qc=QC), PRIOR, hold="foh"), unbalance(), DT
    )(TIMES[:12], wide)  # fmt: skip
    assert_close(result["x_hat"][:, 4:8], one["x_hat"], 1e-9)
    assert_close(result["P"][:, 4:8, 4:8], one["P"], 1e-9)


@pytest.mark.parametrize(
    ("term", "linear"),
    [
        (lambda x, u: x.q * ca.exp(u.t) / (1 + u.t**2), True),
        (lambda x, u: ca.if_else(u.t > 1, x.q, -x.q), True),
        (lambda x, u: ca.sign(x.q), False),
        (lambda x, u: x.q * x.v, False),
        (lambda x, u: u.t / x.q, False),
        (lambda x, u: ca.if_else(x.q > 0, u.t, 0), False),
    ],
)
def test_what_is_linear_in_the_states(term, linear):
    model = Model(
        f=lambda x, u, p: [x.v, term(x, u)], h=lambda x, u, p: [x.q],
        states={"q": "", "v": ""}, inputs={"t": ""}, outputs={"y": ""},
    )  # fmt: skip
    assert (bent(model) == []) == linear


def test_what_cannot_be_is_refused():
    noise = Noise(sigma_y=1.0, sigma_w=1e-3)
    with pytest.raises(TuningError, match="no steady state"):
        KalmanFilter(noise, PRIOR, steady_state=True).compile(unbalance(), DT)
    with pytest.raises(TuningError, match=r"limits go with constant coefficients.*use MHE"):
        LinearMHE(noise, PRIOR, N=3, arrival_weight=1.0).compile(unbalance(upper=1.0), DT)
    forced = Model(
        f=lambda x, u, p: [u.t * x.q + p.F], h=lambda x, u, p: [x.q], states={"q": ""},
        inputs={"t": ""}, outputs={"y": ""}, parameters={"F": 0.0},
    )  # fmt: skip
    with pytest.raises(ModelError, match="use KalmanFilter, LinearMHE"):
        JointInput(noise, Prior(1.0), forces=("F",)).compile(forced, DT)
