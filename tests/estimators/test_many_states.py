"""Windows of many states: seven oscillators in one model are seven windows."""

import dataclasses

import numpy as np
import pytest

from backsight.engine import vm
from backsight.estimators import EKF, IEKF, MHE, MHO, UKF, LinearMHE, Noise, Prior
from backsight.models.lti import lti
from backsight.models.model import Model
from closeness import assert_close

OSCILLATORS, SAMPLES, DT = 7, 22, 0.1
SETTINGS = {"noise": Noise(sigma_y=0.1, sigma_w=0.05), "prior": Prior(sigma_x0=1.0), "N": 5}


def oscillators(stiffness: list[float], *, lower: float = -np.inf) -> Model:
    """With their displacements measured; `lower` bounds that of each."""
    n = len(stiffness)
    A = np.zeros((2 * n, 2 * n))
    for i, k in enumerate(stiffness):
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0.0, 1.0], [-k, -0.2]]
    names = {f"{s}{i}": "" for i in range(n) for s in "qv"}
    model = lti(
        A, np.tile([[0.0], [1.0]], (n, 1)), np.kron(np.eye(n), [[1.0, 0.0]]), states=names,
        inputs={"u": ""}, outputs={f"y{i}": "" for i in range(n)},
    )  # fmt: skip
    bounded = [
        dataclasses.replace(x, lower=lower) if x.name.startswith("q") else x for x in model.states
    ]
    return dataclasses.replace(model, states=tuple(bounded))


def run(estimator, model, u, y):
    recursion = estimator.compile(model, DT)
    data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
    _, outputs = vm.run(recursion, data, carry=recursion.carry0)
    return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}


@pytest.mark.parametrize(
    ("estimator", "lower", "close"),
    [
        (LinearMHE(**SETTINGS), -np.inf, 1e-9),
        (LinearMHE(**SETTINGS, arrival_weight=0.7, hold="foh"), -np.inf, 1e-9),
        (MHO(**SETTINGS), -0.2, 1e-6),
        (MHE(**SETTINGS), -0.2, 1e-6),
    ],
    ids=["linear", "linear with arrival cost", "observer", "estimator"],
)
def test_oscillators_in_one_model(estimator, lower, close):
    """With gaps, and with displacements at their bounds where there are any."""
    rng = np.random.default_rng(5)
    u, y = rng.standard_normal((SAMPLES, 1)), 0.5 * rng.standard_normal((SAMPLES, OSCILLATORS))
    y[9, 0] = y[12:14, -1] = np.nan
    stiffness = [1.0 + i for i in range(OSCILLATORS)]
    together = run(estimator, oscillators(stiffness, lower=lower), u, y)
    for i in (0, OSCILLATORS - 1):
        alone = run(estimator, oscillators([stiffness[i]], lower=lower), u, y[:, [i]])
        part = slice(2 * i, 2 * i + 2)
        assert_close(together["x_hat"][:, part], alone["x_hat"], close)
        assert_close(together["P"][:, part, part], alone["P"], close)
        assert lower == -np.inf or (alone["x_hat"][:, 0] == lower).any()


def large(kind: str, *, states: int = 50, outputs: int = 8) -> tuple[Model, dict[str, np.ndarray]]:
    """A discrete-time model, every state of which moves a few others, or all of them."""
    rng = np.random.default_rng(2)
    A = np.kron(np.diag(rng.uniform(0.8, 0.99, states // 2)), [[0.8, 0.6], [-0.6, 0.8]])
    if kind == "dense":
        turn, _ = np.linalg.qr(rng.standard_normal((states, states)))
        A = turn @ A @ turn.T
    B, C = rng.standard_normal((states, 1)), rng.standard_normal((outputs, states))
    model = lti(
        A, B, C, states={f"x{i}": "" for i in range(states)}, inputs={"u": ""},
        outputs={f"y{i}": "" for i in range(outputs)}, dt=DT,
    )  # fmt: skip
    return model, {"A": A, "B": B, "C": C}


def filtered(m: dict[str, np.ndarray], u, y, *, q: float, R, p: float):
    """Means and variances after every sample, in the plainest way."""
    n = len(m["A"])
    x, P = np.zeros(n), p * np.eye(n)
    for k in range(len(y)):
        rows = np.isfinite(y[k])
        C = m["C"][rows]
        K = np.linalg.solve(C @ P @ C.T + R[np.ix_(rows, rows)], C @ P).T
        x = x + K @ (y[k, rows] - C @ x)
        P = P - K @ C @ P
        yield x, np.diag(P)
        x, P = m["A"] @ x + m["B"] @ u[k], m["A"] @ P @ m["A"].T + q * np.eye(n)


@pytest.mark.parametrize(
    ("method", "kind", "joint"),
    [
        (EKF, "few", False),
        (IEKF, "few", True),
        (UKF, "dense", True),
        (MHE, "few", False),
        (MHE, "dense", True),
    ],
)
def test_fifty_states_against_the_filter_of_the_textbooks(method, kind, joint):
    """Of a linear model all of them are the Kalman filter, gaps and correlated noise included."""
    model, matrices = large(kind)
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((9, 1)), rng.standard_normal((9, 8))
    y[4, 2:5] = y[6] = np.nan
    R = 0.04 * (np.eye(8) + 0.5 * joint)
    settings = {"N": 3} if method is MHE else {}
    found = run(method(Noise(R=R, sigma_w=0.1), Prior(sigma_x0=0.5), **settings), model, u, y)
    expected = list(filtered(matrices, u, y, q=0.01, R=R, p=0.25))
    for k, (x, variances) in enumerate(expected):
        np.testing.assert_allclose(found["x_hat"][k], x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.diag(found["P"][k]), variances, rtol=1e-9)
