"""A discrete linear Gaussian system with two inputs, two outputs and correlated noise."""

import dataclasses

import numpy as np

from backsight.engine import vm
from backsight.estimators import Noise, Prior
from backsight.estimators.base import AbstractEstimator
from backsight.models.lti import lti
from backsight.models.model import Model
from backsight.models.signals import Signal

DT = 0.1
A = np.array([[0.9, 0.3, 0.0], [-0.4, 0.8, 0.1], [0.0, 0.0, 1.0]])
B = np.array([[0.1, 0.0], [0.0, 0.5], [0.0, 0.0]])
C = np.array([[1.0, 0.0, 0.5], [0.2, 1.0, 0.0]])
Q = np.array([[2e-3, 1e-3, 0.0], [1e-3, 3e-3, 0.0], [0.0, 0.0, 0.0]])
R = np.array([[0.04, 0.015], [0.015, 0.09]])
X0 = np.array([0.5, -1.0, 0.2])
P0 = np.array([[1.0, 0.2, 0.0], [0.2, 2.0, 0.3], [0.0, 0.3, 0.5]])
SYSTEM = {"A": A, "B": B, "C": C}
GAUSSIANS = {"noise": Noise(R=R, Q=Q), "prior": Prior(P0=P0, x0=X0)}


def model(bounds: tuple[tuple[float, float], ...] = ((-np.inf, np.inf),) * 3) -> Model:
    states = {
        n: Signal(value=x, lower=low, upper=high)
        for n, x, (low, high) in zip("abc", X0, bounds, strict=True)
    }
    return lti(A, B, C, states=states, inputs={"f": "", "g": ""}, outputs={"y": "", "z": ""}, dt=DT)


def record(n: int, *, seed: int, missing: float) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (n, 2) and outputs (n, 2), of which a fraction is NaN."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 2))
    x, outputs = rng.multivariate_normal(X0, P0), []
    for command in u:
        outputs.append(C @ x + rng.multivariate_normal(np.zeros(2), R))
        x = A @ x + B @ command + rng.multivariate_normal(np.zeros(3), Q)
    y = np.array(outputs)
    y[rng.random(y.shape) < missing] = np.nan
    return u, y


@dataclasses.dataclass(frozen=True)
class Run:
    """An estimator at work on arrays, without datasets."""

    estimator: AbstractEstimator
    model: Model
    dt: float

    def __call__(self, u: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
        """Outputs of the recursion by name; NaN in y is not measured."""
        recursion = self.estimator.compile(self.model, self.dt)
        data = [u, np.nan_to_num(y), np.isfinite(y).astype(float)]
        _, outputs = vm.run(recursion, data, carry=recursion.carry0)
        return {c.name: c.unpack(o) for c, o in zip(recursion.channels, outputs, strict=True)}
