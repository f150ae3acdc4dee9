"""Covariances of moving horizon estimation at bounds, of constants that walk, and by rounding."""

import numpy as np
import pytest

from backsight.errors import TuningError
from backsight.estimators import MHE, Limit, LinearMHE, Noise, Prior
from backsight.estimators.arrival import EKFArrival, SmoothedArrival, UKFArrival
from backsight.models.lti import lti
from backsight.models.signals import Signal
from backsight.schema import Status
from relations.linear import Run

A = np.array([[1.0, 1.0], [0.0, 1.0]])
C = np.array([[1.0, 0.0]])
SIGMA_W, SIGMA_X0, SIGMA_Y = np.array([0.05, 0.03]), np.array([1.0, 0.3]), 0.5


def drift(**bounds: tuple[float, float]):
    """A place that a constant or walking slope carries away."""
    low, high = bounds.get("slope", (-np.inf, np.inf))
    states = {"place": Signal(), "slope": Signal(value=max(0.0, low), lower=low, upper=high)}
    return lti(A, np.zeros((2, 0)), C, states=states, inputs={}, outputs={"y": ""}, dt=1.0)


@pytest.mark.parametrize("lag", [0, 3])
def test_covariance_counts_the_walk_of_a_constant(lag):
    """The estimate is linear in the data: its error under the true noise, by brute force."""
    n, k = 9, 8 - lag
    estimator = MHE(
        Noise(sigma_y=SIGMA_Y, sigma_w=SIGMA_W), Prior(sigma_x0=SIGMA_X0), N=12,
        constant=("slope",), lag=lag,
    )  # fmt: skip
    run = Run(estimator, drift(), 1.0)
    u, units = np.zeros((n, 0)), np.vstack([np.zeros(n), np.eye(n)])
    answers = [run(u, y[:, None]) for y in units]
    gain = np.array([a["x_hat"][-1] - answers[0]["x_hat"][-1] for a in answers[1:]]).T
    # States are sums of the first one and the noise: T, of the outputs C T and their own noise.
    powers = [np.linalg.matrix_power(A, i) for i in range(n)]
    T = np.zeros((n, 2, 2 * n))
    for i in range(n):
        for j in range(i + 1):
            T[i, :, 2 * j : 2 * j + 2] = powers[i - j]
    spread = np.concatenate([SIGMA_X0, *[SIGMA_W] * (n - 1)])
    error = T[k] - gain @ (C @ T)[:, 0]
    expected = error * spread**2 @ error.T + SIGMA_Y**2 * gain @ gain.T
    np.testing.assert_allclose(answers[0]["P"][-1], expected, rtol=1e-8)


def linear_mhe(**settings) -> LinearMHE:
    return LinearMHE(**settings, arrival_weight=1.0)


@pytest.mark.parametrize("method", [MHE, linear_mhe])
def test_bands_at_a_bound_hold_the_truth(method):
    """A slope of 0.01 that must not be negative: never farther from the truth than without bound.

    To impose it is to project on a convex set that the truth is in, in the metric of P.
    """
    settings = {"noise": Noise(R=[[1.0]], Q=np.diag([0.01, 0.0])), "prior": Prior(
        P0=np.diag([1.0, 0.09]), x0=[0.0, 0.2])}  # fmt: skip
    rng = np.random.default_rng(3)
    bounds = ({"slope": (0.0, np.inf)}, {})
    bounded, free = (Run(method(**settings, N=4), drift(**b), 1.0) for b in bounds)
    at_bound = 0
    for _ in range(4):
        x, truth, y = np.array([rng.standard_normal(), 0.01]), [], []
        for _ in range(20):
            truth.append(x)
            y.append(C @ x + rng.standard_normal(1))
            x = A @ x + [0.1 * rng.standard_normal(), 0.0]
        ours, theirs = (run(np.zeros((20, 0)), np.array(y)) for run in (bounded, free))
        np.testing.assert_allclose(ours["P"], theirs["P"], rtol=1e-9)
        far = [np.einsum("ki,kij,kj->k", e, np.linalg.inv(theirs["P"]), e)
               for e in (r["x_hat"] - truth for r in (ours, theirs))]  # fmt: skip
        assert np.all(far[0] <= far[1] + 1e-9)
        at_bound += np.count_nonzero(ours["x_hat"][:, 1] == 0.0)
    assert at_bound > 10


def test_soft_bound_is_soft_in_the_result():
    """By hand: 0.5 x^2 + 2 (2 - x)^2 + 1.5 max(x - 0.5, 0)^2 is least at 9.5 / 8."""
    plant = lti([[1.0]], np.zeros((1, 0)), [[1.0]], states={"x": Signal(upper=0.5)}, inputs={},
                outputs={"y": ""}, dt=1.0)  # fmt: skip
    estimator = MHE(Noise(R=[[0.25]], Q=[[0.04]]), Prior(P0=[[1.0]]), N=1, soft={"x": 3.0})
    for arrival in (SmoothedArrival(), EKFArrival(), UKFArrival()):
        given = MHE(estimator.noise, estimator.prior, 1, arrival, soft=estimator.soft)
        result = Run(given, plant, 1.0)(np.zeros((2, 0)), np.array([[2.0], [np.nan]]))
        np.testing.assert_allclose(result["x_hat"][0, 0], 1.1875, rtol=1e-12)


@pytest.mark.parametrize("method", [MHE, linear_mhe])
def test_contradiction_leaves_the_estimate_outside_the_bounds(method):
    """A bound of 0.5 and a limit of 0.7: without them (4 * 2) / (1 + 4)."""
    plant = lti([[1.0]], np.zeros((1, 0)), [[1.0]], states={"x": Signal(upper=0.5)}, inputs={},
                outputs={"y": ""}, dt=1.0)  # fmt: skip
    estimator = method(
        noise=Noise(R=[[0.25]], Q=[[0.04]]), prior=Prior(P0=[[1.0]]), N=1,
        limits=(Limit("high", {"x": 1.0}, lower=0.7),),
    )  # fmt: skip
    result = Run(estimator, plant, 1.0)(np.zeros((1, 0)), np.array([[2.0]]))
    np.testing.assert_allclose(result["x_hat"], [[1.6]], rtol=1e-12)
    assert int(result["status"][0]) == int(Status.INFEASIBLE)
    np.testing.assert_array_equal(result["infeasible"], [[1.0, 1.0]])


@pytest.mark.parametrize("what", ["Q", "P0"])
def test_covariance_of_rank_one_may_have_many_states(what):
    """As one random force makes it; rounding of its eigenvalues is no negative variance."""
    n = 200
    b = np.random.default_rng(1).standard_normal(n)
    plant = lti(0.9 * np.eye(n), np.zeros((n, 0)), np.ones((1, n)), inputs={},
                states={f"x{i}": "" for i in range(n)}, outputs={"y": ""}, dt=1.0)  # fmt: skip
    if what == "Q":
        assert Noise(R=[[1.0]], Q=np.outer(b, b)).process(plant).shape == (n, n)
    else:
        assert Prior(P0=np.outer(b, b)).covariance(plant).shape == (n, n)
    with pytest.raises(TuningError, match="not positive semidefinite"):
        Prior(P0=np.outer(b, b) - 1e-6 * np.eye(n)).covariance(plant)
