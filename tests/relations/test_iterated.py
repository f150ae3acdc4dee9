"""The iterated filter: between the extended Kalman filter and the maximum a posteriori estimate."""

import numpy as np
import pytest
from scipy.optimize import minimize

from backsight.discrete.runge_kutta import Integrator
from backsight.errors import TuningError
from backsight.estimators import EKF, IEKF, Noise, Prior
from backsight.estimators.kalman import iekf
from backsight.estimators.scaled import setting
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.schema import Status
from backsight.testing import DT, TrialProblem
from closeness import assert_close
from oracles.kalman import kalman_filter
from relations.linear import DT as PERIOD
from relations.linear import GAUSSIANS, P0, SYSTEM, X0, Q, R, Run, model, record

ANCHORS = np.array([[0.0, 0.0], [1.0, 0.0]])
SENSOR, PRIOR, WALK = 0.01, 0.4, 0.02
NEAR = {"noise": Noise(sigma_y=SENSOR, sigma_w=WALK), "prior": Prior(sigma_x0=PRIOR, x0=[0.3, 0.5])}


def distances(lower: float = -np.inf) -> Model:
    """A point that walks, seen by its distances to two anchors nearby: bent over its own width."""
    return Model(
        f=lambda x, u, p: [x.a, x.b],
        h=ranges,
        states={n: Signal(value=1.0, lower=lower, scale=1.0) for n in "ab"},
        inputs={},
        outputs={"r": "", "s": ""},
        dt=PERIOD,
    )


def ranges(x, u, p):
    return [((x.a - a) ** 2 + (x.b - b) ** 2 + 1e-6) ** 0.5 for a, b in ANCHORS.tolist()]


def measured(x: np.ndarray) -> np.ndarray:
    return np.sqrt(((x - ANCHORS) ** 2).sum(axis=1) + 1e-6)


def walks(seed: int, n: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = np.array([0.3, 0.5]) + PRIOR * rng.standard_normal(2)
    path = np.vstack([x, x + np.cumsum(WALK * rng.standard_normal((n - 1, 2)), axis=0)])
    y = np.array([measured(p) for p in path]) + SENSOR * rng.standard_normal((n, 2))
    return np.zeros((n, 0)), path, y


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_one_iteration_is_the_extended_filter(hold):
    problem = TrialProblem()
    data = problem.simulate(80, seed=1, hold=hold, noisy=True)
    y = data.y.copy()
    y[::3, 0] = np.nan
    settings = {"noise": problem.noise, "prior": problem.prior, "integrator": Integrator(hold=hold)}
    expected = Run(EKF(**settings), problem.model, DT)(data.u, y)
    one = Run(IEKF(**settings, max_iterations=1, tolerance=0.0), problem.model, DT)(data.u, y)
    for name, values in expected.items():
        assert_close(one[name], values, 1e-12)


@pytest.mark.parametrize("missing", [0.0, 0.4])
def test_on_a_linear_model_it_is_the_kalman_filter(missing):
    u, y = record(80, seed=1, missing=missing)
    result = Run(IEKF(**GAUSSIANS), model(), PERIOD)(u, y)
    x, P = kalman_filter(y, u, **SYSTEM, Q=Q, R=R, x0=X0, P0=P0)
    assert_close(result["x_hat"], x, 1e-11)
    assert_close(result["P"], P, 1e-11)
    assert not result["status"].any()


@pytest.mark.parametrize("seed", range(5))
def test_it_minimises_the_cost_of_every_sample(seed):
    """Against a general optimiser, whose minimum is as sharp as the square root of its rounding."""
    u, _, y = walks(seed)
    result = Run(IEKF(**NEAR, max_iterations=50), distances(), PERIOD)(u, y)
    x, P = np.array([0.3, 0.5]), PRIOR**2 * np.eye(2)
    for k in range(len(y)):
        best = minimise(y[k], x, P, result["x_hat"][k])
        assert_close(result["x_hat"][k], best, 1e-6)
        x, P = result["x_hat"][k], result["P"][k] + WALK**2 * np.eye(2)
    assert not result["status"].any()


def minimise(y: np.ndarray, x: np.ndarray, P: np.ndarray, start: np.ndarray) -> np.ndarray:
    def cost(z: np.ndarray) -> float:
        e, d = (y - measured(z)) / SENSOR, z - x
        return 0.5 * float(e @ e + d @ np.linalg.solve(P, d))

    return minimize(cost, start + 1e-3, method="BFGS", options={"gtol": 1e-9}).x


def test_it_is_nearer_to_the_truth_than_the_extended_filter_where_the_output_is_bent():
    errors = {EKF: [], IEKF: []}
    for seed in range(40):
        u, path, y = walks(seed, n=1)
        for kind, found in errors.items():
            x_hat = Run(kind(**NEAR), distances(), PERIOD)(u, y)["x_hat"]
            found.append(np.linalg.norm(x_hat[0] - path[0]))
    assert np.median(errors[IEKF]) < 0.4 * np.median(errors[EKF])


def test_no_step_makes_the_estimate_less_likely_than_that_of_the_extended_filter():
    """Full steps would: the first sample needs halved ones."""
    start = {"noise": Noise(sigma_y=1e-3), "prior": Prior(sigma_x0=1.0, x0=[3.0])}
    bent = Model(
        f=lambda x, u, p: [x.a],
        h=lambda x, u, p: [x.a / (1 + x.a**2) ** 0.5],
        states={"a": ""}, inputs={}, outputs={"y": ""}, dt=PERIOD,
    )  # fmt: skip
    y, u = np.array([[0.2]]), np.zeros((1, 0))

    def cost(x: float) -> float:
        return ((0.2 - x / (1 + x**2) ** 0.5) / 1e-3) ** 2 + (x - 3.0) ** 2

    costs = [
        cost(3.0 if n == 0 else run(start, bent, n)(u, y)["x_hat"][0, 0]) for n in range(1, 30)
    ]
    assert np.all(np.diff(costs) <= 1e-9 * np.array(costs[:-1]))
    assert costs[-1] < 1e-3 * costs[0]


def run(settings: dict, model: Model, n: int) -> Run:
    return Run(IEKF(**settings, max_iterations=n, tolerance=0.0), model, PERIOD)


def test_a_sample_that_did_not_converge_says_so():
    u, _, y = walks(0)
    few = Run(IEKF(**NEAR, max_iterations=2), distances(), PERIOD)(u, y)
    assert int(few["status"][0]) == int(Status.ITERATION_LIMIT)


def test_bounds_are_kept_and_reported():
    u, y = np.zeros((3, 0)), np.tile(measured(np.array([0.2, 0.5])), (3, 1))
    result = Run(IEKF(**NEAR), distances(lower=0.29), PERIOD)(u, y)
    assert result["x_hat"].min() >= 0.29 - 1e-12
    at_bound = (result["x_hat"] <= 0.29 * (1 + 1e-12)).any(axis=1)
    assert at_bound.any()
    assert np.all((result["status"][at_bound].astype(int) & int(Status.CLIPPED)) != 0)


def test_many_states():
    """Beside the point there are 14 more, which know nothing of it and stay as they are."""
    names = [*"ab", *(f"z{i}" for i in range(14))]
    large = Model(
        f=lambda x, u, p: [getattr(x, n) for n in names],
        h=ranges,
        states={n: Signal(scale=1.0) for n in names}, inputs={}, outputs={"r": "", "s": ""},
        dt=PERIOD,
    )  # fmt: skip
    u, _, y = walks(5)
    prior = Prior(sigma_x0=PRIOR, x0={"a": 0.3, "b": 0.5})
    result = Run(IEKF(NEAR["noise"], prior), large, PERIOD)(u, y)
    expected = Run(IEKF(**NEAR), distances(), PERIOD)(u, y)
    assert_close(result["x_hat"][:, :2], expected["x_hat"], 1e-10)
    assert_close(result["P"][:, :2, :2], expected["P"], 1e-10)
    assert not result["x_hat"][:, 2:].any()


@pytest.mark.parametrize(
    ("setting", "message"),
    [({"max_iterations": 0}, "from 1 on"), ({"tolerance": float("nan")}, "not be negative")],
)
def test_wrong_settings(setting, message):
    with pytest.raises(TuningError, match=message):
        IEKF(**NEAR, **setting)


@pytest.mark.parametrize(("length", "taken"), [(0.9e-6, True), (1.1e-6, False)])
def test_the_last_step_is_taken_though_rounding_raises_the_cost(length, taken):
    """So short a step changes the cost by 1e-12, which is less than what it rounds to."""
    s = setting(distances(), PERIOD, **NEAR, integrator=Integrator())
    judge = iekf._judge(s, 1e-6)
    go, w, _, J, t = judge(1, [0, 0], [9, 9], 1.0, 1.0, [1, 2], 1.0 + 1e-10, length)
    assert float(go) == (not taken)
    assert (float(w[1]), float(J)) == ((2.0, 1.0 + 1e-10) if taken else (0.0, 1.0))
    assert float(t) == (1.0 if taken else 0.5)
