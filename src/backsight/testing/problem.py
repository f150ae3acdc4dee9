"""The problem that every estimator has to solve.

The problem is an oscillator with unknown stiffness, mildly nonlinear in the joint state
(q, v, k): measured displacement and speed with correlated noise, known force. It can be posed in
other units and with other internal scales; the truth is computed here in NumPy by the same
Runge-Kutta steps that the estimators use, or by the matrix exponential for those that use it, so
that the model is perfect.
"""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.linalg import expm

from backsight import schema
from backsight.estimators.uncertainty import Noise, Prior
from backsight.models.augment import augment
from backsight.models.model import Model
from backsight.models.signals import Signal

DT = 0.02
"""Sampling period [s]."""

UNITS = {"position": "length", "speed": "length/s"}
DAMPING = 2.0
"""Per mass [1/s]."""

K_TRUE = 150.0
"""Stiffness per mass [1/s2]."""

WALK = np.array([1e-3, 2e-2, 0.0])
"""Random step of every state per sample."""

R = np.array([[1e-4, 3e-4], [3e-4, 1e-2]])
"""Covariance of the measurement."""


@dataclasses.dataclass(frozen=True)
class TrialProblem:
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
    outputs : tuple of str
        What is measured, one or both of "position" and "speed", in this order.
    exact : bool
        The true motion is that of the matrix exponential; needs `k_known`.
    """

    length: float = 1.0
    scales: dict[str, float] = dataclasses.field(default_factory=dict)
    k_bounds: tuple[float, float] = (1.0, 1e4)
    k_known: bool = False
    outputs: tuple[str, ...] = ("position", "speed")
    exact: bool = False

    @property
    def step(self) -> Callable[[np.ndarray, float, float], np.ndarray]:
        """The true motion over one period, ``(x, ua, ub) -> x``."""
        return exponential if self.exact else runge_kutta

    @property
    def ny(self) -> int:
        """Number of outputs."""
        return len(self.outputs)

    @property
    def nx(self) -> int:
        """Number of states."""
        return 2 if self.k_known else 3

    @property
    def factors(self) -> np.ndarray:
        """From metres to the units of the states."""
        return np.array([self.length, self.length, 1.0])[: self.nx]

    @property
    def noise(self) -> Noise:
        """What the simulation does."""
        of_sensors = self.length**2 * R[: self.ny, : self.ny]
        return Noise(R=of_sensors, sigma_w=WALK[: self.nx] * self.factors)

    @property
    def prior(self) -> Prior:
        """Wide enough for the start."""
        return Prior(sigma_x0=np.array([0.05, 0.5, 40.0])[: self.nx] * self.factors)

    @property
    def model(self) -> Model:
        """In these units; of the stiffness, a state unless it is known."""
        lower, upper = self.k_bounds
        value = K_TRUE if self.k_known else 120.0
        k = Signal("1/s2", value, scale=self.scales.get("k"), lower=lower, upper=upper)
        plant = Model(
            f=lambda x, u, p: [x.v, -p.k * x.q - p.b * x.v + u.F + p.push],
            h=lambda x, *_: [x.q, x.v][: self.ny],
            states={n: Signal("length", scale=self.scales.get(n)) for n in ("q", "v")},
            inputs={"F": "length/s2"},
            outputs={n: u for n, u in UNITS.items() if n in self.outputs},
            parameters={"k": k, "b": (DAMPING, "1/s"), "push": (0.0, "length/s2")},
        )
        return plant if self.k_known else augment(plant, ["k"])

    def simulate(self, n: int, *, seed: int, hold: str, noisy: bool) -> "Data":
        """A motion as the problem's sensors see it, in metres; the caller's own to change."""
        data = _simulated(n, seed, hold, noisy, self.ny, self.step)
        return Data(data.u.copy(), data.x.copy(), data.y.copy())


@dataclasses.dataclass(frozen=True)
class Data:
    """Inputs (n, 1), true states (n, 3) and outputs (n, ny)."""

    u: np.ndarray
    x: np.ndarray
    y: np.ndarray

    @property
    def mask(self) -> np.ndarray:
        """1 where measured, else 0, (n, ny)."""
        return np.isfinite(self.y).astype(float)

    @property
    def arrays(self) -> list[np.ndarray]:
        """What an engine takes: u, y and mask."""
        return [self.u, np.nan_to_num(self.y), self.mask]

    def scaled(self, length: float) -> "Data":
        """The same in other units of length."""
        return Data(self.u * length, self.x * [length, length, 1.0], self.y * length)

    def recording(self, model: Model) -> xr.Dataset:
        """What a user has of it."""
        return schema.recording(
            np.arange(len(self.u)) * DT,
            u=self.u,
            y=self.y,
            inputs={s.name: s.unit for s in model.inputs},
            outputs={s.name: s.unit for s in model.outputs},
            dt=DT,
        )


def simulated(
    n: int,
    *,
    seed: int,
    hold: str,
    noisy: bool,
    ny: int = 2,
    step: Callable[[np.ndarray, float, float], np.ndarray] | None = None,
) -> Data:
    """Motion under a random staircase force (ramps, if the input is interpolated).

    Half of the random walk is added before and half after each step: that is what the trapezoidal
    rule of the default covariance propagation stands for.
    """
    rng, advance = np.random.default_rng(seed), step or runge_kutta
    u = np.repeat(5.0 * rng.standard_normal(n // 5 + 2), 5)[: n + 1]
    x = np.array([0.02, -0.1, K_TRUE])
    states = []
    for i in range(n):
        states.append(x)
        walks = noisy * WALK * rng.standard_normal((2, 3)) / np.sqrt(2)
        x = advance(x + walks[0], u[i], u[i + 1] if hold == "foh" else u[i]) + walks[1]
    noise = noisy * rng.multivariate_normal(np.zeros(2), R, size=n)
    truth = np.array(states)
    return Data(u[:n, None], truth, (truth[:, :2] + noise)[:, :ny])


@functools.lru_cache(maxsize=512)
def _simulated(
    n: int,
    seed: int,
    hold: str,
    noisy: bool,
    ny: int,
    step: Callable[[np.ndarray, float, float], np.ndarray],
) -> Data:
    """`simulated`, once for all estimators."""
    return simulated(n, seed=seed, hold=hold, noisy=noisy, ny=ny, step=step)


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


def exponential(x: np.ndarray, ua: float, ub: float) -> np.ndarray:
    """Exact step of the oscillator with the true stiffness; the input goes from ua to ub."""
    held = EXACT @ np.array([x[0], x[1], ua, (ub - ua) / DT])
    return np.array([held[0], held[1], x[2]])


EXACT = expm(DT * np.array([[0.0, 1, 0, 0], [-K_TRUE, -DAMPING, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]]))
"""Of displacement, speed, force and its slope."""
