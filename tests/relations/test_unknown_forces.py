"""The joint input and state filter is a Kalman filter whose forces are very large white noise."""

import casadi as ca
import numpy as np
import pytest

from backsight.estimators import JointInput, KalmanFilter, Noise, Prior
from backsight.models.model import Model
from relations.linear import DT, P0, X0, A, B, C, Q, R, Run, model, record

E = np.array([0.2, 0.7, 0.1])


def pushed() -> Model:
    """The system with an unknown force that moves its states by E."""
    plain = model()
    x, u, p = ca.SX.sym("x", 3), ca.SX.sym("u", 2), ca.SX.sym("p")
    return Model(
        f=ca.Function("f", [x, u, p], [A @ x + B @ u + E * p]),
        h=ca.Function("h", [x, u, p], [C @ x]),
        states=plain.states,
        inputs=plain.inputs,
        outputs=plain.outputs,
        parameters={"d": 0.0},
        dt=DT,
    )


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_infinite_variance_is_the_limit(missing):
    """The difference falls with the variance, and is nothing at a large one."""
    u, y = record(80, seed=4, missing=missing)
    y[np.isnan(y).all(axis=1), 0] = 0.1  # one channel is enough for one force, none is not
    prior = Prior(P0=P0, x0=X0)
    expected = Run(JointInput(Noise(R=R, Q=Q), prior, forces=("d",)), pushed(), DT)(u, y)
    assert not expected["status"].any()
    differences = []
    for size in (1e2, 1e3):
        noise = Noise(R=R, Q=Q + size**2 * np.outer(E, E))
        white = Run(KalmanFilter(noise, prior), model(), DT)(u, y)
        differences.append([np.abs(white[n] - expected[n]).max() for n in ("x_hat", "P")])
    assert np.all(np.array(differences[1]) < 1e-4)
    assert np.all(np.array(differences[1]) < 0.02 * np.array(differences[0]))
