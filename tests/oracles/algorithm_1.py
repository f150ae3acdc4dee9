"""Algorithm 1 of the compressive-sensing MHE, window after window, on the plain reference."""

import dataclasses

import numpy as np

from oracles.sparse_forces import Array, Expected, System, Window, solve


@dataclasses.dataclass(frozen=True)
class Setup:
    """What `CompressiveSensingMHE` is told; `drift` None is no carryover."""

    lam: float
    N: int
    shapes: Array
    x0: Array
    P0: Array
    arrival: str = "SmoothedArrival"
    drift: tuple[float, float] | None = None
    reading: str = "separate"
    age: int = 1
    change: float = np.inf
    threshold: float = 0.0
    sign: int = 0


def windows(system: System, setup: Setup, y: Array, u: Array) -> list[tuple[int, Window]]:
    """First sample and solution of the window of every sample."""
    N, atoms = setup.N, setup.shapes.shape[2]
    start, x, P, found = 0, setup.x0, setup.P0, []
    steps = N + 1 if system.F.any() else N
    expected, past = None, np.zeros((0, atoms))
    for k in range(len(y)):
        rows = slice(start, k + 1)
        w = solve(
            system, y[rows], u[rows], x0=x, P0=P, shapes=setup.shapes, lam=setup.lam,
            tail=_tail(past, setup.shapes, k + 1 - start), expected=expected, sign=setup.sign,
        )  # fmt: skip
        found.append((start, w))
        if k - start < N:
            continue
        x, P = _arrival(system, setup, y[start], u[start], x, P, w)
        past = np.vstack([past, w.alpha[:1]])
        expected = _expected(setup, w, expected, steps, direct=system.F.any())
        start += 1
    return found


def _tail(past: Array, shapes: Array, samples: int) -> Array:
    """What atoms of steps before the window still do in it."""
    tail = np.zeros((samples, len(shapes)))
    for back, factors in enumerate(past[::-1], start=1):
        for k in range(min(samples, shapes.shape[1] - back)):
            tail[k] += shapes[:, k + back, :] @ factors
    return tail


def _arrival(
    s: System, setup: Setup, y: Array, u: Array, x: Array, P: Array, w: Window
) -> tuple[Array, Array]:
    if setup.arrival == "SmoothedArrival(naive)":
        return w.x[1], w.P[1]
    if setup.arrival == "ConstantArrival":
        return w.x[1], setup.P0
    m, d = np.isfinite(y), w.forces[0]
    C, D, F, R = s.C[m], s.D[m], s.F[m], s.R[np.ix_(m, m)]
    background = np.diag(s.sigma2)
    both = s.A @ P @ C.T + s.E @ background @ F.T
    K = both @ np.linalg.inv(C @ P @ C.T + F @ background @ F.T + R)
    ahead = s.A @ x + s.B @ u + s.E @ d + K @ (y[m] - C @ x - D @ u - F @ d)
    spread = s.A @ P @ s.A.T + s.Q + s.E @ background @ s.E.T - K @ both.T
    atoms = setup.shapes.shape[2]
    J = (s.E - K @ F) @ setup.shapes[:, 0, :]
    return ahead, spread + J @ w.covariance[:atoms, :atoms] @ J.T


def _expected(
    setup: Setup, w: Window, before: Expected | None, steps: int, *, direct: bool
) -> Expected | None:
    if setup.drift is None:
        return None
    drift = np.linspace(*setup.drift, steps)
    mean, variance = np.zeros_like(w.alpha), np.zeros_like(w.alpha)
    sigma = np.diag(w.covariance).reshape(w.alpha.shape)
    for j in range(1, steps):
        seen = setup.N - j + bool(direct)
        for a, value in enumerate(w.alpha[j]):
            if value != 0 and abs(value) >= setup.threshold and seen >= setup.age:
                known = before is not None and before.variance[j, a] > 0
                mean[j - 1, a] = value
                variance[j - 1, a] = drift[j - 1] + (sigma[j, a] if known else 0)
    return Expected(mean, variance, setup.reading)
