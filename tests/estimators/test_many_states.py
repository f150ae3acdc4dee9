"""Windows of many states: seven oscillators in one model are seven windows."""

import dataclasses

import numpy as np
import pytest

from backsight.engine import vm
from backsight.estimators import MHE, MHO, LinearMHE, Noise, Prior
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
