"""A gain that is reused: the filter that computes it at every sample, within the promised bound."""

import functools

import numpy as np
import pytest
import scipy

from backsight.discrete.riccati import riccati_limit
from backsight.engine import native, vm
from backsight.estimators import EKF, JointInput, KalmanFilter, Noise, Prior
from backsight.estimators.outliers import Gate
from backsight.estimators.parts.linear import linear
from backsight.estimators.steady.state import DIFFERENCE, steady_state
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.structures.second_order import second_order
from closeness import assert_close
from oracles.kalman import kalman_filter

MODES, SENSORS, DT, SAMPLES = 7, 5, 0.05, 420
NX = 2 * MODES


def matrices() -> dict[str, np.ndarray]:
    """Oscillators with 4 % damping and more, one of them four times as slow as the next."""
    rng = np.random.default_rng(4)
    A, B = np.zeros((NX, NX)), np.zeros((NX, 3))
    for i in range(MODES):
        w = 2.0 if i == 0 else 6.0 + 4 * i
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0, 1], [-(w**2), -0.4 * w]]
        B[2 * i + 1] = rng.standard_normal(3)
    C = np.zeros((SENSORS, NX))
    C[:, 1::2] = rng.standard_normal((SENSORS, MODES))
    C[:, ::2] = rng.standard_normal((SENSORS, MODES))
    return {"A": A, "B": B, "C": C}


def model() -> Model:
    names = {f"x{i}": "" for i in range(NX)}
    return lti(
        **matrices(), states=names, inputs={"u": "", "f": "", "g": ""},
        outputs={f"y{i}": "" for i in range(SENSORS)},
    )  # fmt: skip


def system(hold: str = "zoh"):
    return linear(model(), DT, noise=NOISE, prior=PRIOR, hold=hold)


NOISE, PRIOR = Noise(sigma_y=0.1, sigma_w=0.1), Prior(sigma_x0=1.0)


@functools.cache
def recording(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs of the model itself, nothing missing."""
    rng, s = np.random.default_rng(seed), system()
    u, x, y = rng.standard_normal((SAMPLES, 3)), s.s.x0, []
    for command in u:
        y.append(s.C @ x + np.sqrt(np.diag(s.s.R)) * rng.standard_normal(SENSORS))
        x = s.A @ x + s.B @ command + np.linalg.cholesky(s.s.Q) @ rng.standard_normal(NX)
    return u, np.array(y) * s.s.sy


def through(estimator, u, y, *, weights=None, of=None, dt=DT, run=vm.run):
    """Results by name, and how many samples the gain still waits at the end."""
    recursion = estimator.compile(of or model(), dt)
    seen = np.isfinite(y) * (1.0 if weights is None else weights)
    carry, outputs = run(recursion, [u, np.nan_to_num(y), seen], carry=recursion.carry0)
    found = {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
    return found, carry[-2]


def pair(kind, u, y, *, noise=NOISE, weights=None, of=None, dt=DT, **settings):
    """The filter that reuses its gain, and the one that never does."""
    both = (kind(noise, PRIOR, gain=gain, **settings) for gain in ("converged", "exact"))
    return tuple(through(each, u, y, weights=weights, of=of, dt=dt) for each in both)


def assert_within_the_bound(found, exact, *, times=10.0):
    """Estimates by their deviations, variances relatively; a normal quantity stays below ten."""
    std = np.sqrt(np.diagonal(exact["P"], axis1=1, axis2=2))
    assert (np.abs(found["x_hat"] - exact["x_hat"]) / std).max() < times * DIFFERENCE
    for name in ("P", "S"):
        size = np.sqrt(np.diagonal(exact[name], axis1=1, axis2=2))
        by = np.abs(found[name] - exact[name]) / size[:, :, None] / size[:, None, :]
        assert by.max() < times * DIFFERENCE
    assert np.array_equal(found["status"], exact["status"])


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_the_gain_is_reused_and_nobody_sees_it(hold):
    u, y = recording()
    (found, waits), (exact, _) = pair(KalmanFilter, u, y, hold=hold)
    assert waits == 0
    assert np.array_equal(found["P"][-1], found["P"][-2])
    assert_within_the_bound(found, exact)
    assert not np.array_equal(found["x_hat"], exact["x_hat"])


@functools.cache
def dense() -> Model:
    """A dozen states that all depend on each other, as straight-line code."""
    rng = np.random.default_rng(1)
    A, C = rng.standard_normal((12, 12)), rng.standard_normal((6, 12))
    return lti(
        0.8 * A / np.abs(np.linalg.eigvals(A)).max(), np.zeros((12, 0)), C,
        states={f"x{i}": "" for i in range(12)}, inputs={},
        outputs={f"y{i}": "" for i in range(6)}, dt=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [KalmanFilter, EKF])
def test_few_states_with_much_to_do(kind):
    """A gap, a noise of its own, and the way back; the innovation before a sample enters, too."""
    u, y = np.zeros((260, 0)), np.random.default_rng(5).standard_normal((260, 6))
    y[100:103, 2] = np.nan
    weights = np.ones_like(y)
    weights[170] = 0.5
    (found, waits), (exact, _) = pair(kind, u, y, weights=weights, of=dense(), dt=1.0)
    assert waits == 0
    assert_within_the_bound(found, exact)
    assert not np.array_equal(found["x_hat"], exact["x_hat"])
    gated = Noise(sigma_y=0.1, sigma_w=0.1, outliers=Gate())
    (found, _), (exact, _) = pair(kind, u, y, noise=gated, of=dense(), dt=1.0)
    assert_within_the_bound(found, exact)
    assert np.array_equal(found["weight"], exact["weight"])


def test_of_a_row_of_few_masses_all_is_computed():
    row = 4e4 * (2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1))
    masses = second_order(
        np.eye(4), 5e-4 * row, row, forces={"f": "q1"}, inputs={"f": "N"},
        outputs={"a": ("displacement", "q1")},
    )  # fmt: skip
    sizes = {
        gain: len(KalmanFilter(NOISE, PRIOR, gain=gain).compile(masses, DT).carry0)
        for gain in ("converged", "exact")
    }
    assert sizes["converged"] == sizes["exact"]


def test_against_the_filter_of_the_textbooks():
    u, y = recording()
    y = y.copy()
    y[250:253, 1] = np.nan
    s = system()
    assert s.s.sx == pytest.approx(s.s.sx[0])
    found, waits = through(KalmanFilter(NOISE, PRIOR), u, y)
    assert waits == 0
    x, P = kalman_filter(y / s.s.sy, u, A=s.A, B=s.B, C=s.C, Q=s.s.Q, R=s.s.R, x0=s.s.x0, P0=s.s.P0)
    assert_close(found["x_hat"] / s.s.sx, x, 1e-9)
    assert_close(found["P"] / np.outer(s.s.sx, s.s.sx), P, 1e-9)


@pytest.mark.parametrize(
    ("where", "sensors"), [(slice(220, 221), [2]), (slice(220, 250), slice(None))]
)
def test_a_gap_goes_back_to_the_exact_way(where, sensors):
    """At once; with the gain kept the difference would be seen."""
    u, y = recording()
    gap = y.copy()
    gap[where, sensors] = np.nan
    (found, waits), (exact, _) = pair(KalmanFilter, u, gap)
    assert_within_the_bound(found, exact)
    assert waits == 0
    assert np.abs(exact["P"][where.stop] / exact["P"][where.start - 1] - 1).max() > 1e-3


def test_other_noise_and_outliers_go_back_to_the_exact_way():
    u, y = recording()
    weights = np.ones_like(y)
    weights[310:315, 0] = 0.3
    weights[330:, 1] = 0.5
    (found, waits), (exact, _) = pair(KalmanFilter, u, y, weights=weights)
    assert_within_the_bound(found, exact)
    assert waits > 0
    wild = y.copy()
    wild[[312, 350], 3] += 50.0
    (found, waits), (exact, _) = pair(
        KalmanFilter, u, wild, noise=Noise(sigma_y=0.1, sigma_w=0.1, outliers=Gate())
    )
    assert_within_the_bound(found, exact)
    assert np.array_equal(found["weight"], exact["weight"])
    assert not found["weight"][312, 3]


@pytest.mark.parametrize("direct", [False, True])
def test_joint_input(direct):
    """Forces found one sample later, and at once."""
    n, kind = MODES, "acceleration" if direct else "displacement"
    row = 4e4 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    forced = second_order(
        np.eye(n), 40 * np.eye(n) + 1e-3 * row, row, forces={"f": "q1", "g": "q4"},
        parameters={"f": (0.0, "N"), "g": (0.0, "N")},
        outputs={"a": (kind, "q1"), "b": (kind, "q4"), "c": ("displacement", "q6"),
                 "d": ("displacement", "q2")},
    )  # fmt: skip
    y = np.random.default_rng(1).standard_normal((SAMPLES, 4)) * 0.1
    y[230:232, 3] = np.nan
    (found, waits), (exact, _) = pair(
        JointInput, np.zeros((SAMPLES, 0)), y, forces=("f", "g"), of=forced, dt=1 / 400
    )
    assert waits == 0
    assert_within_the_bound(found, exact)
    std = np.sqrt(np.diagonal(exact["P_d"], axis1=1, axis2=2))
    assert (np.abs(found["d_hat"] - exact["d_hat"]) / std).max() < 1e-9
    assert_close(found["P_d"], exact["P_d"], 1e-8)


def test_as_machine_code():
    u, y = recording()
    gap = y.copy()
    gap[200, 2] = np.nan
    estimator = KalmanFilter(NOISE, PRIOR)
    here, there = (through(estimator, u, gap, run=engine.run) for engine in (vm, native))
    assert here[1] == there[1] == 0
    for name in ("x_hat", "P", "e", "S"):
        assert_close(there[0][name], here[0][name], 1e-11)


def test_what_does_not_converge_is_computed_exactly():
    """A constant that no noise moves is known ever better."""
    A, names = np.eye(NX), {f"x{i}": "" for i in range(NX)}
    drift = lti(
        A, np.zeros((NX, 0)), A[:SENSORS], states=names, inputs={},
        outputs={f"y{i}": "" for i in range(SENSORS)}, dt=DT,
    )  # fmt: skip
    sizes = {
        gain: len(KalmanFilter(NOISE_AT_REST, PRIOR, gain=gain).compile(drift, DT).carry0)
        for gain in ("converged", "exact")
    }
    assert sizes["converged"] == sizes["exact"]


NOISE_AT_REST = Noise(sigma_y=0.1)


def test_the_limit_is_that_of_the_riccati_equation():
    s = system()
    start = riccati_limit(s.A, s.C, s.s.Q, s.s.R)
    wanted = scipy.linalg.solve_discrete_are(s.A.T, s.C.T, s.s.Q, s.s.R)
    assert_close(start, wanted, 1e-10)
    assert riccati_limit(np.eye(2), np.zeros((1, 2)), np.eye(2), np.eye(1)) is None
    assert riccati_limit(1.1 * np.eye(2), np.zeros((1, 2)), np.eye(2), np.eye(1)) is None


def test_the_bound_holds_from_anywhere_near_the_limit():
    """Gains of the limit, taken too early by far, so that rounding does not hide the difference.

    By the covariance of the errors that they make: what it is above the smallest possible one.
    """
    s, rng = system(), np.random.default_rng(2)
    A, C, Q, R = s.A, s.C, s.s.Q, s.s.R
    limit = steady_state(riccati_limit(A, C, Q, R), functools.partial(closed, s))
    P, n = limit.P, len(A)
    sigma = limit.sigma
    phi, noise = closed(s, P)
    for sign in (1.0, -1.0):
        G = rng.standard_normal((n, 3))
        near = sign * (sigma[:, None] * G) @ (sigma[:, None] * G).T
        near *= 1e-3 / np.linalg.norm(near / np.outer(sigma, sigma))
        least, own, k = P + near, P + near, 6
        power = np.linalg.matrix_power(phi, k)
        size = np.linalg.norm(np.linalg.solve(np.linalg.cholesky(P), power * sigma)) ** 2
        for sample in range(60):
            free, extra = closed(s, least)
            least = free @ least @ free.T + extra
            own = (phi if sample >= k else free) @ own @ (phi if sample >= k else free).T
            own = own + (noise if sample >= k else extra)
            more = np.sqrt(np.maximum(np.diag(own - least), 0) / np.diag(P))
            assert more.max() < 2 * np.sqrt(2) * 1e-3 * size + 1e-7


def closed(s, P):
    AK = s.A @ np.linalg.solve(s.C @ P @ s.C.T + s.s.R, s.C @ P).T
    return s.A - AK @ s.C, s.s.Q + AK @ s.s.R @ AK.T
