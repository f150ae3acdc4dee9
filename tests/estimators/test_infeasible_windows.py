"""Windows whose limits contradict each other say so, as linear programs of SciPy do."""

import numpy as np
import pytest
import scipy.optimize

import backsight as bs
from backsight.schema import Status

N, SAMPLES = 5, 22
BOX = {"x0": (-0.3, 0.4), "x2": (-0.5, np.inf)}
LIMITS = (
    bs.settings.Limit("gap", {"x0": 1.0, "x1": -1.0}, -0.3, 0.6),
    bs.settings.Limit("push", {"x1": 1.0}, -0.05, 0.3, of="noise"),
)


def covariance(rng, n, size):
    root = rng.standard_normal((n, n))
    return size * (root @ root.T / n + 0.1 * np.eye(n))


def drawn(seed):
    """A random system of three states, its noise and prior, and what is measured of it."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((3, 1)), rng.standard_normal((2, 3))
    D = rng.standard_normal((2, 1))
    Q, R, P0 = (covariance(rng, n, size) for n, size in ((3, 0.2), (2, 0.5), (3, 1.0)))
    x0, u = 0.2 * rng.standard_normal(3), rng.standard_normal((SAMPLES, 1))
    x, y = rng.multivariate_normal(x0, P0), []
    for k in range(SAMPLES):
        y.append(C @ x + D @ u[k] + rng.multivariate_normal(np.zeros(2), R))
        x = A @ x + B @ u[k] + rng.multivariate_normal(np.zeros(3), Q)
    y = np.array(y)
    y[rng.random(y.shape) < 0.15] = np.nan
    return A, B, C, D, Q, R, P0, np.clip(x0, [-0.3, -9, -0.5], [0.4, 9, 9]), u, y


def violation(A, B, u):
    """By how much the limits of a window must be violated at least; the noise is free otherwise."""
    n = len(u)
    size = 6 * n + 1
    equal, right, below, least = [], [], [], []
    for j in range(n - 1):
        row = np.zeros((3, size))
        row[:, 3 * (j + 1) : 3 * (j + 2)], row[:, 3 * j : 3 * (j + 1)] = np.eye(3), -A
        row[:, 3 * (n + j) : 3 * (n + j + 1)] = -np.eye(3)
        equal.append(row)
        right.append(B @ u[j])
    for j in range(n):
        for weights, lower, upper, at in (
            ([1, 0, 0], *BOX["x0"], 3 * j), ([0, 0, 1], *BOX["x2"], 3 * j),
            ([1, -1, 0], -0.3, 0.6, 3 * j), ([0, 1, 0], -0.05, 0.3, 3 * (n + j)),
        ):  # fmt: skip
            if at >= 3 * n and j == n - 1:
                continue
            for sign, end in ((1, upper), (-1, -lower)):
                if np.isfinite(end):
                    row = np.zeros(size)
                    row[at : at + 3], row[-1] = sign * np.array(weights), -1
                    below.append(row)
                    least.append(end)
    cost = np.zeros(size)
    cost[-1] = 1
    free = [(None, None)] * (size - 1) + [(0, None)]
    ends = {"A_eq": np.vstack(equal), "b_eq": np.concatenate(right)} if equal else {}
    return scipy.optimize.linprog(cost, np.array(below), least, bounds=free, **ends).fun


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mhe", "lmhe"])
def test_infeasible_windows_are_told(method):
    """Seed 10: the active limits of two windows go round in circles, of one from every start."""
    A, B, C, D, Q, R, P0, x0, u, y = drawn(10)
    states = {
        f"x{i}": bs.Signal(lower=lower, upper=upper, value=float(x0[i]))
        for i, (lower, upper) in enumerate((BOX["x0"], (-np.inf, np.inf), BOX["x2"]))
    }
    outputs = {"y0": "", "y1": ""}
    model = bs.lti(A, B, C, D, states=states, inputs={"u": ""}, outputs=outputs, dt=1.0)
    recording = bs.from_arrays(u=u, y=y, inputs={"u": ""}, outputs=outputs, dt=1.0)
    noise, prior = bs.Noise(R=R, Q=Q), bs.Prior(P0=P0, x0=x0)
    if method == "mhe":
        estimator = bs.MHE(noise, prior, N=N, limits=LIMITS)
    else:
        estimator = bs.LinearMHE(noise, prior, N=N, arrival_weight=1.0, limits=LIMITS)
    result = bs.estimate(estimator, model, recording, engine="vm", throw=False)
    least = [violation(A, B, u[max(0, k - N) : k + 1]) for k in range(SAMPLES)]
    impossible = np.array(least) > 1e-7
    assert impossible.sum() > 4
    told = (result["status"].values & int(Status.INFEASIBLE)) > 0
    open_ = (result["status"].values & int(Status.ITERATION_LIMIT)) > 0
    assert np.array_equal(told, impossible)
    assert not open_.any()
