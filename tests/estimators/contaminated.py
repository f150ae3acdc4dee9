"""A vibration whose measurements have outliers, and filters for it."""

import dataclasses

import numpy as np

import backsight as bs

DT, N = 0.02, 400
R, Q = np.diag([1e-4, 1e-2]), np.diag([1e-6, 4e-4])
RULES = (bs.settings.Gate(), bs.settings.StudentT(), bs.settings.Huber())


def plant() -> bs.Model:
    return bs.lti(
        [[1.0, DT], [-150 * DT, 1 - 2 * DT]],
        [[0.0], [DT]],
        np.eye(2),
        states={"q": "m", "v": "m/s"},
        inputs={"F": "N"},
        outputs={"y": "m", "z": "m/s"},
        dt=DT,
    )


@dataclasses.dataclass(frozen=True)
class Motion:
    """A vibration, its measurements with and without outliers, and where they are."""

    x: np.ndarray
    u: np.ndarray
    clean: np.ndarray
    dirty: np.ndarray
    bad: np.ndarray

    def recording(self, y):
        return bs.from_arrays(
            u=self.u, y=y, dt=DT, inputs={"F": "N"}, outputs={"y": "m", "z": "m/s"}
        )


def motion(n: int = N, *, seed: int = 0, share: float = 0.01) -> Motion:
    rng, model = np.random.default_rng(seed), plant()
    A, B = np.array([[1.0, DT], [-150 * DT, 1 - 2 * DT]]), np.array([0.0, DT])
    u = np.repeat(5 * rng.standard_normal(n // 5 + 1), 5)[:n]
    x, states = np.array([0.02, -0.1]), []
    for k in range(n):
        states.append(x)
        x = A @ x + B * u[k] + rng.multivariate_normal(np.zeros(2), Q)
    clean = np.array(states) + rng.multivariate_normal(np.zeros(2), R, n)
    bad = rng.random((n, 2)) < share
    size = rng.choice([-1, 1], (n, 2)) * rng.uniform(50, 500, (n, 2)) * np.sqrt(np.diag(R))
    assert model.ny == 2
    return Motion(np.array(states), u, clean, clean + bad * size, bad)


MOTION = motion()


def noise(rule=None, **changes) -> bs.Noise:
    return bs.Noise(**{"R": R, "Q": Q, "outliers": rule, **changes})


PRIOR = bs.Prior(sigma_x0={"q": 0.05, "v": 0.5})


def kalman(n):
    return bs.KalmanFilter(n, PRIOR)
