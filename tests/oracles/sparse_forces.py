"""Compressive-sensing MHE written down as the optimisation problem that it is (eq. 8-14).

Unknown are the first state, the background noise of every step, and the factors of the atoms; the
outputs are simulated from them, one unit vector after the other, and nothing is eliminated. The
problem is solved by an interior point method on positive and negative parts and polished on the
support that it finds.
"""

import dataclasses

import numpy as np

Array = np.ndarray


@dataclasses.dataclass(frozen=True)
class System:
    """x+ = A x + B u + E d + w, y = C x + D u + F d + v; background forces of variance `sigma2`."""

    A: Array
    B: Array
    C: Array
    D: Array
    E: Array
    F: Array
    Q: Array
    R: Array
    sigma2: Array

    @property
    def noise(self) -> Array:
        """Root of the covariance of what background and process noise add to state and output."""
        both = np.vstack([self.E, self.F])
        joint = both @ np.diag(self.sigma2) @ both.T
        joint[: len(self.Q), : len(self.Q)] += self.Q
        return root(joint)


@dataclasses.dataclass(frozen=True)
class Expected:
    """What Algorithm 1 hands on: means and variances of atoms (steps, atoms); 0 is not expected."""

    mean: Array
    variance: Array
    reading: str


@dataclasses.dataclass(frozen=True)
class Window:
    """States (samples + 1, nx), their covariances, and atoms (steps, atoms) with theirs."""

    x: Array
    P: Array
    alpha: Array
    covariance: Array
    cost: float
    forces: Array


def root(P: Array) -> Array:
    values, vectors = np.linalg.eigh(P)
    return vectors * np.sqrt(np.maximum(values, 0))


def solve(
    system: System,
    y: Array,
    u: Array,
    *,
    x0: Array,
    P0: Array,
    shapes: Array,
    lam: float,
    tail: Array,
    expected: Expected | None = None,
    sign: int = 0,
) -> Window:
    """Solve a window: y (samples, ny) with NaN where not measured, tail (samples, forces) known."""
    samples, nx = len(y), len(x0)
    atoms = shapes.shape[2]
    first, noise = root(P0), system.noise
    q = noise.shape[1]
    steps = samples if system.F.any() else samples - 1
    sizes = [nx, samples * q, steps * atoms]
    total = sum(sizes)

    def simulate(z: Array, known: float) -> tuple[Array, Array]:
        a, w, alpha = np.split(z, np.cumsum(sizes)[:-1])
        w, alpha = w.reshape(samples, q) @ noise.T, alpha.reshape(steps, atoms)
        d = known * tail + pulses(alpha, shapes, samples)
        x, xs, ys = known * x0 + first @ a, [], []
        for k in range(samples):
            xs.append(x)
            ys.append(system.C @ x + known * system.D @ u[k] + system.F @ d[k] + w[k, nx:])
            x = system.A @ x + known * system.B @ u[k] + system.E @ d[k] + w[k, :nx]
        return np.array([*xs, x]), np.array(ys)

    base, predicted = simulate(np.zeros(total), 1.0)
    unit = [simulate(e, 0.0) for e in np.eye(total)]
    J = np.array([x for x, _ in unit])
    G = np.array([y_.ravel() for _, y_ in unit]).T
    seen = np.isfinite(y).ravel()
    weight = np.linalg.inv(np.linalg.cholesky(np.kron(np.eye(samples), system.R)[seen][:, seen]))
    n = total - sizes[2]
    rows = [weight @ G[seen], np.eye(total)[:n]]
    right = [weight @ (y.ravel() - predicted.ravel())[seen], np.zeros(n)]
    penalty = np.concatenate([np.zeros(n), np.full(sizes[2], lam)])
    which = []
    if expected is not None:
        variance, mean = expected.variance[:steps].ravel(), expected.mean[:steps].ravel()
        which = np.flatnonzero(variance)
        extra = np.zeros((len(which), total + len(which)))
        if expected.reading == "separate":
            rows = [np.hstack([r, r[:, n + which]]) for r in rows]
            extra[:, total:] = np.diag(variance[which] ** -0.5)
            penalty = np.concatenate([penalty, np.zeros(len(which))])
            J = np.concatenate([J, J[n + which]])
        else:
            extra[:, n + which] = np.diag(variance[which] ** -0.5)
            extra = extra[:, :total]
            if expected.reading == "release":
                penalty[n + which] = 0.0
        rows, right = [*rows, extra], [*right, mean[which] * variance[which] ** -0.5]
    M, t = np.vstack(rows), np.concatenate(right)
    z, free = lasso(M, t, penalty, sign)
    cost = float(np.sum((M @ z - t) ** 2) + penalty @ np.abs(z))
    Sigma = np.zeros((len(z), len(z)))
    Sigma[np.ix_(free, free)] = np.linalg.inv(M[:, free].T @ M[:, free])
    x = base + np.einsum("i,ikx->kx", z, J)
    P = np.array([j.T @ Sigma @ j for j in J.transpose(1, 0, 2)])
    pick = np.eye(len(z))[n : n + sizes[2]]
    if len(z) > total:
        pick[which, total + np.arange(len(which))] = 1.0
    alpha = (pick @ z).reshape(steps, atoms)
    forces = pulses(alpha, shapes, samples) + tail
    return Window(x, P, alpha, pick @ Sigma @ pick.T, cost, forces)


def pulses(alpha: Array, shapes: Array, samples: int) -> Array:
    """Forces (samples, forces) of atoms that begin at the steps."""
    d = np.zeros((samples + shapes.shape[1], len(shapes)))
    for k, factors in enumerate(alpha):
        d[k : k + shapes.shape[1]] += np.einsum("fwa,a->wf", shapes, factors)
    return d[:samples]


def lasso(M: Array, t: Array, penalty: Array, sign: int = 0) -> tuple[Array, Array]:
    """Minimise |M z - t|^2 + penalty' |z|; the minimiser and where it is not zero."""
    if not penalty.any():
        return np.linalg.lstsq(M, t, rcond=None)[0], np.arange(len(penalty))
    bent = np.flatnonzero(penalty)
    straight = np.flatnonzero(penalty == 0)
    parts = [M[:, straight]]
    for side in (1, -1):
        parts.append(side * (M[:, bent] if side * sign >= 0 else 0 * M[:, bent]))
    split, n = np.hstack(parts), len(straight)
    c = np.concatenate([np.zeros(n), penalty[bent], penalty[bent]])
    size = 2 * len(bent)
    H, g = 2 * split.T @ split, c - 2 * split.T @ t
    z = np.concatenate([np.zeros(n), np.ones(size)])
    s = np.full(size, penalty[bent].mean())
    for _ in range(80):
        p = z[n:]
        mu = 0.1 * (p @ s) / size
        gradient = H @ z + g
        gradient[n:] -= s
        K = H.copy()
        K[np.arange(n, n + size), np.arange(n, n + size)] += s / p
        K[np.diag_indices(len(K))] += 1e-13 * np.diag(H).max()
        right = -gradient
        right[n:] += mu / p - s
        dz = np.linalg.solve(K, right)
        ds = mu / p - s - s / p * dz[n:]
        step = 1.0
        for value, change in ((p, dz[n:]), (s, ds)):
            down = change < 0
            if down.any():
                step = min(step, 0.99 * np.min(-value[down] / change[down]))
        z, s = z + step * dz, s + step * ds
        if z[n:] @ s < 1e-7 * size * penalty.max():
            break
    p, half = z[n:], len(bent)
    signs = np.zeros(len(penalty))
    signs[bent] = 1.0 * (p[:half] > FOUND) - (p[half:] > FOUND)
    return polished(M, t, penalty, signs, sign)


FOUND = 1e-4
"""Factors above this are certainly part of the solution of the interior point method."""


def polished(M: Array, t: Array, penalty: Array, signs: Array, sign: int) -> tuple[Array, Array]:
    """Solve the equations of a support with its signs, and mend it until all conditions hold."""
    for _ in range(100):
        free = np.flatnonzero((penalty == 0) | (signs != 0))
        A = M[:, free]
        z = np.zeros(len(penalty))
        z[free] = np.linalg.solve(A.T @ A, A.T @ t - (penalty * signs)[free] / 2)
        slope = 2 * M.T @ (t - M @ z)
        over = (np.abs(slope) if sign == 0 else sign * slope) - penalty
        over[free] = -np.inf
        against = z * signs
        if against.min() < 0:
            signs[against.argmin()] = 0.0
        elif over.max() > 1e-9 * penalty.max():
            signs[over.argmax()] = np.sign(slope[over.argmax()])
        else:
            return z, free
    raise AssertionError("the reference did not find the minimiser")
