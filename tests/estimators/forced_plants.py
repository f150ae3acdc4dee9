"""A cantilever and a chain of masses on which forces act, as models and from sample to sample."""

import dataclasses

import numpy as np

from backsight.discrete.exact import zoh
from backsight.models.lti import state_space
from backsight.models.model import Model
from backsight.models.structures import beam, forces_as_inputs, second_order

DT = 1 / 400
PLACES = (0.245, 0.325, 0.405)
ALL = ("F1", "F2", "F3")


def cantilever(kind: str, *, sensors=PLACES, forces=PLACES, inputs=()) -> Model:
    """Three modes; sensors of one kind, forces F1, F2... and inputs U1, U2... at places."""
    return beam(
        0.405,
        width=0.025,
        thickness=0.003,
        youngs_modulus=65.9e9,
        density=7502.0,
        damping=[0.030, 0.037, 0.119],
        sensors={f"y{i + 1}": (kind, x) for i, x in enumerate(sensors)},
        forces={f"F{i + 1}": x for i, x in enumerate(forces)},
        inputs={f"U{i + 1}": x for i, x in enumerate(inputs)},
    )


def chain(kind: str) -> Model:
    """Seven masses in a row, 14 states; sensors and unknown forces at the first three."""
    n, of = 7, ("q1", "q2", "q3")
    stiffness = 4e4 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    return second_order(
        np.eye(n),
        1e-3 * stiffness,
        stiffness,
        forces={f"F{i + 1}": q for i, q in enumerate(of)},
        parameters={f"F{i + 1}": (0.0, "N") for i in range(3)},
        outputs={f"y{i + 1}": (kind, q) for i, q in enumerate(of)},
    )


@dataclasses.dataclass(frozen=True)
class Plant:
    """The same model from sample to sample: x+ = A x + B u + E d, y = C x + D u + F d."""

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray

    def run(self, d, *, u=None, x0: float | np.ndarray = 0.0, w=0.0, v=0.0):
        """States (n, nx) and outputs (n, ny)."""
        u = np.zeros((len(d), self.B.shape[1])) if u is None else u
        w = np.broadcast_to(w, (len(d), len(self.A)))
        x, rows = np.zeros(len(self.A)) + x0, []
        for k in range(len(d)):
            rows.append(x)
            x = self.A @ x + self.B @ u[k] + self.E @ d[k] + w[k]
        x = np.array(rows)
        return x, x @ self.C.T + u @ self.D.T + d @ self.F.T + v


def plant(model: Model, forces=ALL) -> Plant:
    A, B, C, D = state_space(forces_as_inputs(model, forces))
    A, B = zoh(A, B, dt=DT)
    n = model.nu
    return Plant(A, B[:, :n], B[:, n:], C, D[:, :n], D[:, n:])
