"""The problem that every estimator has to solve, and one line for each estimator.

The problem is an oscillator with unknown stiffness, mildly nonlinear in the joint state
(q, v, k): measured displacement and speed with correlated noise, known force. It can be posed in
other units and with other internal scales; the truth is computed here in NumPy by the same
Runge-Kutta steps that the estimators use, so that the model is perfect.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from backsight import schema
from backsight.discrete.runge_kutta import Integrator
from backsight.estimators import EKF, MHO, Noise, Prior
from backsight.estimators.base import AbstractEstimator
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal

Build = Callable[[Noise, Prior, Integrator], AbstractEstimator]

CASES: dict[str, Build] = {
    "ekf": lambda noise, prior, integrator: EKF(noise, prior, integrator=integrator),
    # The observer uses the measurements of its window in the filters and in the cost, but counts
    # them once in P. With alpha = 1 its mean NIS is 3 to 5 % too high for that reason; with
    # alpha = 0.1 the effect is below the width of the chi-square band used here.
    "mho": lambda noise, prior, integrator: MHO(
        noise, prior, N=5, alpha=0.1, integrator=integrator
    ),
}
"""Every estimator by its key, in a setting in which its statistics hold."""

DT = 0.02
DAMPING = 2.0
K_TRUE = 150.0
WALK = np.array([1e-3, 2e-2, 0.0])
R = np.array([[1e-4, 3e-4], [3e-4, 1e-2]])


@dataclasses.dataclass(frozen=True)
class Problem:
    """The oscillator in some units and with some internal scales.

    Parameters
    ----------
    length : float
        How many units of length there are in a metre.
    scales : dict
        `Signal.scale` of the states, none by default.
    k_bounds : tuple
        Lower and upper bound of the stiffness per mass.
    k_known : bool
        The stiffness is given: the states are then q and v and the model is linear.
    """

    length: float = 1.0
    scales: dict[str, float] = dataclasses.field(default_factory=dict)
    k_bounds: tuple[float, float] = (1.0, 1e4)
    k_known: bool = False

    @property
    def nx(self) -> int:
        return 2 if self.k_known else 3

    @property
    def factors(self) -> np.ndarray:
        """From metres to the units of the states."""
        return np.array([self.length, self.length, 1.0])[: self.nx]

    @property
    def noise(self) -> Noise:
        return Noise(R=self.length**2 * R, sigma_w=WALK[: self.nx] * self.factors)

    @property
    def prior(self) -> Prior:
        return Prior(sigma_x0=np.array([0.05, 0.5, 40.0])[: self.nx] * self.factors)

    @property
    def model(self) -> Model:
        lower, upper = self.k_bounds
        value = K_TRUE if self.k_known else 120.0
        k = Signal("1/s2", value, scale=self.scales.get("k"), lower=lower, upper=upper)
        plant = Model(
            f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F],
            h=lambda x, u, p: [x.q, x.v],
            states={n: Signal("length", scale=self.scales.get(n)) for n in ("q", "v")},
            inputs={"F": "length/s2"},
            outputs={"position": "length", "speed": "length/s"},
            parameters={"k": k, "b": (DAMPING, "1/s")},
        )
        return plant if self.k_known else augment(plant, ["k"])


@dataclasses.dataclass(frozen=True)
class Data:
    """Inputs (n, 1), true states (n, 3) and outputs (n, 2)."""

    u: np.ndarray
    x: np.ndarray
    y: np.ndarray

    @property
    def mask(self) -> np.ndarray:
        return np.isfinite(self.y).astype(float)

    @property
    def arrays(self) -> list[np.ndarray]:
        """What an engine takes: u, y and mask."""
        return [self.u, np.nan_to_num(self.y), self.mask]

    def scaled(self, length: float) -> "Data":
        return Data(self.u * length, self.x * [length, length, 1.0], self.y * length)

    def recording(self, model: Model):
        return schema.recording(
            np.arange(len(self.u)) * DT,
            u=self.u,
            y=self.y,
            inputs={s.name: s.unit for s in model.inputs},
            outputs={s.name: s.unit for s in model.outputs},
            dt=DT,
        )


def simulate(n: int, *, seed: int, hold: str, noisy: bool, k: float = K_TRUE) -> Data:
    """Motion under a random staircase force (ramps, if the input is interpolated).

    Half of the random walk is added before and half after each step: that is what the trapezoidal
    rule of the default covariance propagation stands for.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(5.0 * rng.standard_normal(n // 5 + 2), 5)[: n + 1]
    x = np.array([0.02, -0.1, k])
    states = []
    for i in range(n):
        states.append(x)
        walks = noisy * WALK * rng.standard_normal((2, 3)) / np.sqrt(2)
        x = runge_kutta(x + walks[0], u[i], u[i + 1] if hold == "foh" else u[i]) + walks[1]
    noise = noisy * rng.multivariate_normal(np.zeros(2), R, size=n)
    truth = np.array(states)
    return Data(u[:n, None], truth, truth[:, :2] + noise)


def runge_kutta(x: np.ndarray, ua: float, ub: float) -> np.ndarray:
    """One classical Runge-Kutta step of the oscillator; the input goes from ua to ub."""

    def f(x: np.ndarray, u: float) -> np.ndarray:
        return np.array([x[1], u - x[2] * x[0] - DAMPING * x[1], 0.0])

    middle = (ua + ub) / 2
    k1 = f(x, ua)
    k2 = f(x + DT / 2 * k1, middle)
    k3 = f(x + DT / 2 * k2, middle)
    k4 = f(x + DT * k3, ub)
    return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
