"""Machines of which the true states are known, many runs at a time.

The truth moves by the matrix exponential or by many Runge-Kutta steps in NumPy and takes its start
and its noise from the very distributions that the estimators are told.
"""

import dataclasses
from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.linalg import expm

import backsight as bs
from backsight.types import Array

Move = Callable[[Array, float], Array]


@dataclasses.dataclass(frozen=True)
class Plant:
    """A model, what is known of it, and how it moves.

    Parameters
    ----------
    model : Model
        One input, one output, which is the first state.
    move : callable
        Over one sample, ``(x (nx, runs), u) -> x``, without noise.
    mean, start, walk : (nx,) arrays
        Mean and standard deviation of the start, and of what is added per sample.
    sigma_y, dt : float
    true : tuple of float, optional
        Of the last state, a parameter that must not be negative: mean and standard deviation of
        its true value, which is 0 where they give less.
    """

    model: bs.Model
    move: Move
    mean: Array
    start: Array
    walk: Array
    sigma_y: float
    dt: float
    true: tuple[float, float] | None = None

    @property
    def noise(self) -> bs.Noise:
        """What acts on it."""
        return bs.Noise(sigma_y=self.sigma_y, sigma_w=self.walk)

    @property
    def prior(self) -> bs.Prior:
        """Where it starts."""
        return bs.Prior(sigma_x0=self.start, x0=self.mean)


@dataclasses.dataclass(frozen=True)
class Runs:
    """Inputs (n, 1), true states (n, nx, runs) and outputs (n, runs)."""

    u: Array
    x: Array
    y: Array


def drawn(
    plant: Plant,
    runs: int,
    n: int,
    *,
    seed: int,
    R: float = 1.0,
    Q: float = 1.0,
    pushes: Array | None = None,
) -> Runs:
    """Runs of a plant whose noise has R and Q times the variance that the estimators are told.

    Parameters
    ----------
    pushes : (n, runs) array, optional
        A force that adds to the input, unknown to the estimators.
    """
    rng = np.random.default_rng(seed)
    nx = len(plant.mean)
    u = np.repeat(3.0 * rng.standard_normal(n // 5 + 1), 5)[:n]
    x = plant.mean[:, None] + plant.start[:, None] * rng.standard_normal((nx, runs))
    if plant.true is not None:
        mean, spread = plant.true
        x[-1] = np.maximum(mean + spread * rng.standard_normal(runs), 0.0)
    states = []
    for k in range(n):
        states.append(x)
        push = 0.0 if pushes is None else pushes[k]
        walk = np.sqrt(Q) * plant.walk[:, None] * rng.standard_normal((nx, runs))
        x = plant.move(x, u[k] + push) + walk
    truth = np.array(states)
    y = truth[:, 0] + np.sqrt(R) * plant.sigma_y * rng.standard_normal((n, runs))
    return Runs(u[:, None], truth, y)


def oscillator() -> Plant:
    """Linear, 20 rad/s, with a force whose size nobody knows."""
    dt, A = 0.01, np.array([[0.0, 1.0], [-400.0, -2.0]])
    whole = expm(dt * np.block([[A, np.array([[0.0], [1.0]])], [np.zeros((1, 3))]]))
    F, G = whole[:2, :2], whole[:2, 2:]
    model = bs.Model(
        f=lambda x, u, p: [x.v, -400 * x.q - 2 * x.v + u.F + p.push],
        h=lambda x, u, p: [x.q],
        states={"q": "", "v": ""},
        inputs={"F": ""},
        outputs={"y": ""},
        parameters={"push": 0.0},
    )
    return Plant(
        model=model,
        move=lambda x, u: F @ x + G * u,
        mean=np.zeros(2),
        start=np.array([0.02, 0.4]),
        walk=np.array([0.0, 0.1]),
        sigma_y=0.01,
        dt=dt,
    )


def runge_kutta(f: Callable[[Array, float], Array], dt: float, steps: int) -> Move:
    """Classical Runge-Kutta steps of a sample."""
    h = dt / steps

    def move(x: Array, u: float) -> Array:
        for _ in range(steps):
            k1 = f(x, u)
            k2 = f(x + h / 2 * k1, u)
            k3 = f(x + h / 2 * k2, u)
            k4 = f(x + h * k3, u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    return move


def pendulum(*, known: bool = False) -> Plant:
    """Swings as wide as the angle where a linear spring fails; g / l is a state unless known."""
    plain = bs.Model(
        f=lambda x, u, p: [x.w, -p.c * ca.sin(x.a) - 0.3 * x.w + u.M],
        h=lambda x, u, p: [x.a],
        states={"a": "", "w": ""},
        inputs={"M": ""},
        outputs={"y": ""},
        parameters={"c": 20.0},
    )

    def f(x: Array, u: float) -> Array:
        a, w, *c = x
        return np.array([w, -(c or [20.0])[0] * np.sin(a) - 0.3 * w + u, *(0 * k for k in c)])

    nx = 2 if known else 3
    return Plant(
        model=plain if known else bs.augment(plain, ["c"]),
        move=runge_kutta(f, 0.02, 4),
        mean=np.array([1.0, 0.0, 20.0])[:nx],
        start=np.array([0.1, 0.5, 2.0])[:nx],
        walk=np.array([0.0, 0.05, 0.0])[:nx],
        sigma_y=0.02,
        dt=0.02,
    )


def slope() -> Plant:
    """A place that a slope carries away which cannot be negative; linear."""
    model = bs.lti(
        [[1.0, 1.0], [0.0, 1.0]],
        [[1.0], [0.0]],
        [[1.0, 0.0]],
        states={"place": "", "slope": bs.Signal(value=0.2, lower=0.0)},
        inputs={"u": ""},
        outputs={"y": ""},
        dt=1.0,
    )
    return Plant(
        model=model,
        move=lambda x, u: np.array([x[0] + x[1] + u, x[1]]),
        mean=np.array([0.0, 0.2]),
        start=np.array([1.0, 0.3]),
        walk=np.array([0.1, 0.0]),
        sigma_y=1.0,
        dt=1.0,
        true=(0.05, 0.05),
    )


def damping() -> Plant:
    """An oscillator with an unknown damping that cannot be negative."""
    model = bs.augment(
        bs.Model(
            f=lambda x, u, p: [x.v, -100 * x.q - p.b * x.v + u.F],
            h=lambda x, u, p: [x.q],
            states={"q": "", "v": ""},
            inputs={"F": ""},
            outputs={"y": ""},
            parameters={"b": bs.Signal(value=0.5, lower=0.0)},
        ),
        ["b"],
    )

    def f(x: Array, u: float) -> Array:
        q, v, d = x
        return np.array([v, -100 * q - d * v + u, 0 * d])

    return Plant(
        model=model,
        move=runge_kutta(f, 0.01, 2),
        mean=np.array([0.1, 0.0, 0.5]),
        start=np.array([0.01, 0.1, 1.0]),
        walk=np.array([0.0, 0.05, 0.0]),
        sigma_y=2e-3,
        dt=0.01,
        true=(0.1, 0.2),
    )
