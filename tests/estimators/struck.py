"""A structure of two modes that is struck at one of four places, with two sensors."""

import casadi as ca
import numpy as np
from scipy.linalg import expm

from backsight.estimators import Noise, Prior
from backsight.models.model import Model
from oracles.sparse_forces import System

DT = 0.02
FORCES = ("F1", "F2", "F3", "F4")
SHAPES = np.array([[0.2, -0.5], [0.5, -0.6], [0.8, 0.1], [1.0, 1.0]])
STIFFNESS, DAMPING = np.diag([200.0, 1500.0]), np.diag([1.0, 4.0])
SENSORS = np.array([[0.5, -0.6], [1.0, 1.0]])
SIGMA_FORCE = np.array([0.3, 0.3, 0.2, 0.3])
X0 = np.array([0.01, -0.02, 0.1, 0.0])
P0 = np.diag([0.02, 0.02, 0.2, 0.2]) ** 2


def matrices(*, accelerations: bool) -> dict[str, np.ndarray]:
    """Discrete matrices by one matrix exponential; the known force acts at the first place."""
    nothing, one = np.zeros((2, 2)), np.eye(2)
    A = np.block([[nothing, one], [-STIFFNESS, -DAMPING]])
    E, B = np.vstack([np.zeros((2, 4)), SHAPES.T]), np.array([[0], [0], [0.2], [-0.5]])
    grown = expm(DT * np.block([[A, E, B], [np.zeros((5, 9))]]))
    C, D, F = np.hstack([SENSORS, nothing]), np.zeros((2, 1)), np.zeros((2, 4))
    if accelerations:
        C, D, F = SENSORS @ A[2:], SENSORS @ B[2:], SENSORS @ E[2:]
    return {"A": grown[:4, :4], "E": grown[:4, 4:8], "B": grown[:4, 8:], "C": C, "D": D, "F": F}


def system(*, accelerations: bool = False) -> System:
    R = np.array([[1.0, 0.3], [0.3, 2.0]]) * (0.3 if accelerations else 1e-3) ** 2
    Q = np.diag([0.0, 0.0, 1e-2, 1e-2]) ** 2
    return System(**matrices(accelerations=accelerations), Q=Q, R=R, sigma2=SIGMA_FORCE**2)


def model(of: System, dt: float = DT) -> Model:
    """The same in discrete time, with the forces as parameters."""

    def linear(X, U, W):
        def equation(x, u, p):
            values = ca.vertcat(*(p[n] for n in FORCES))
            state = ca.vertcat(*(x[n] for n in ("a", "b", "va", "vb")))
            return ca.vertsplit(ca.DM(X) @ state + ca.DM(U) * u.f + ca.DM(W) @ values)

        return equation

    return Model(
        f=linear(of.A, of.B, of.E),
        h=linear(of.C, of.D, of.F),
        states=dict.fromkeys(("a", "b", "va", "vb"), ""),
        inputs={"f": "N"},
        outputs={"y": "m", "z": "m"},
        parameters=dict.fromkeys(FORCES, (0.0, "N")),
        dt=dt,
        name="struck",
    )


def record(of: System, n: int, *, seed: int, missing: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Known inputs (n, 1) and outputs (n, 2) of a structure that is struck every fourth step."""
    rng = np.random.default_rng(seed)
    u, x, outputs = rng.standard_normal((n, 1)), rng.multivariate_normal(X0, P0), []
    for k in range(n):
        d = SIGMA_FORCE * rng.standard_normal(4)
        if k % 4 == 2:
            d[rng.integers(4)] += rng.choice([-1, 1]) * rng.uniform(6, 12)
        outputs.append(of.C @ x + of.D @ u[k] + of.F @ d + rng.multivariate_normal([0, 0], of.R))
        x = of.A @ x + of.B @ u[k] + of.E @ d + np.sqrt(of.Q) @ rng.standard_normal(4)
    y = np.array(outputs)
    y[rng.random(y.shape) < missing] = np.nan
    return u, y


def gaussians(of: System) -> dict:
    return {"noise": Noise(R=of.R, Q=of.Q), "prior": Prior(P0=P0, x0=X0)}
