"""Smoothing with limits against a dense quadratic program in other unknowns."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from backsight.engine import native
from backsight.engine.recursion import Channel, Recursion
from backsight.solvers.trajectory import Chain, smoothed
from backsight.solvers.trajectory._active import solve

DT = 0.1
OSCILLATOR = np.array([[1.0, DT], [-4 * DT, 1 - 0.2 * DT]])
WALK = np.array([[1, DT, 0], [-4 * DT, 1, DT], [0, 0, 1]])
COUPLED = np.array(
    [[1, DT, 0, 0], [-2 * DT, 1, DT, 0], [0, 0, 1, DT], [DT, 0, -3 * DT, 1]]
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Window:
    """A window of a linear system with limits on sums of states and of noise."""

    F: np.ndarray
    G: np.ndarray
    H: np.ndarray
    L: np.ndarray
    A: np.ndarray
    noise: np.ndarray
    bound: np.ndarray
    softness: np.ndarray
    N: int

    @property
    def chain(self) -> Chain:
        return Chain(
            N=self.N,
            Q=self.G @ self.G.T,
            F=pattern(np.abs(self.F) + np.eye(len(self.F))),
            H=pattern(self.H),
            noise=self.noise,
            A=pattern(self.A),
            softness=self.softness,
            slack=np.full(len(self.A), 1e-10),
        )

    def stages(self, c, e):
        chain, one = self.chain, np.ones((1, self.N + 1))
        F = np.repeat(entries(self.F, chain.F)[:, None], self.N + 1, axis=1)
        F[:, 0] = entries(np.eye(len(self.F)), chain.F)
        before = one.copy()
        before[0, 0] = 0
        low, high = -self.bound[:, None] @ one, self.bound[:, None] @ one
        of_noise = self.noise.any(axis=1)
        low[of_noise, 0], high[of_noise, 0] = -np.inf, np.inf
        H, A = (entries(m, p)[:, None] @ one for m, p in ((self.H, chain.H), (self.A, chain.A)))
        return [F, c, before, H, e, A, low, high]

    def program(self, delta, c, e):
        """Quadratic program in whitened unknowns: H, g, C, low, high; and T, t of the states."""
        nx, m = len(self.F), self.N + 1
        size = nx * m
        T, t, W = np.zeros((size, size)), np.zeros(size), np.zeros((size, size))
        T[:nx, :nx], t[:nx] = self.L, delta
        for i in range(1, m):
            now, last = slice(nx * i, nx * i + nx), slice(nx * i - nx, nx * i)
            T[now] = self.F @ T[last]
            T[now, now] += self.G
            W[now, now] = self.G
            t[now] = self.F @ t[last] + c[:, i]
        M = np.kron(np.eye(m), self.H)
        rows = np.kron(np.eye(m), self.A)
        C = rows @ T + np.kron(np.eye(m), self.noise) @ W
        seen, rest = M @ T, e.T.ravel() - M @ t
        low, high = (np.tile(s * self.bound, m) - rows @ t for s in (-1, 1))
        return np.eye(size) + seen.T @ seen, -seen.T @ rest, C, low, high, T, t


def pattern(matrix) -> ca.Sparsity:
    return ca.sparsify(ca.DM(matrix)).sparsity()


def entries(matrix, where: ca.Sparsity) -> np.ndarray:
    return np.array([matrix[r, k] for r, k in zip(where.row(), where.get_col(), strict=True)])


def window(F, G, H, L, A, bound, *, N, noise=None, softness=None) -> Window:
    A = np.array(A, float)
    return Window(
        F=F,
        G=np.diag(G),
        H=np.array(H, float),
        L=np.diag(L),
        A=A,
        noise=np.zeros_like(A) if noise is None else np.array(noise, float),
        bound=np.array(bound, float),
        softness=np.zeros(len(A)) if softness is None else np.array(softness, float),
        N=N,
    )


WINDOWS = {
    "parameter that hardly walks": window(
        WALK, [1e-3, 1e-2, 1e-6], [[50, 0, 0]], [0.3, 1, 0.5], [[0, 0, 1]], [0.15], N=15
    ),
    "limits that leave no freedom": window(
        OSCILLATOR, [0, 0.3], [[20, 0]], [0.3, 1], np.eye(2), [0.05, 0.4], N=15
    ),
    "many of four states": window(
        COUPLED, [0, 0.01, 0, 0.01], [[20, 0, 0, 0], [0, 0, 20, 0]], [0.3, 1, 0.3, 1],
        np.eye(4), [0.1, 0.3, 0.1, 0.3], N=8,
    ),
    "sums": window(
        WALK, [0.3, 0.1, 0], [[3, 0, 1]], [1, 1, 1],
        [[1, 1, 0], [1, -1, 0], [0, 0, 1], [1, 0, 0]], [0.3] * 4, N=8,
    ),
    "noise": window(
        WALK, [0.1, 0.2, 0.05], [[20, 0, 0]], [0.3, 1, 0.5],
        [[0, 0, 0], [0, 0, 0], [1, 0, 0]], [0.1, 0.02, 0.2],
        noise=[[0, 1, 0], [1, 0, 1], [0, 0, 0]], N=8,
    ),
    "soft and hard": window(
        OSCILLATOR, [0.05, 0.3], [[20, 0]], [0.3, 1], np.eye(2), [0.05, 0.4],
        softness=[1e-3, 0], N=10,
    ),
}  # fmt: skip
"""Windows in which limits are active at many samples."""


@pytest.fixture(params=[12, 1], ids=["unrolled", "loops"], autouse=True)
def largest(request, monkeypatch) -> int:
    """Number of states up to which the code is unrolled; with 1 it never is."""
    monkeypatch.setattr("backsight.solvers.trajectory.chain.UNROLL", request.param)
    return request.param


@pytest.fixture(params=list(WINDOWS))
def case(request) -> Window:
    return WINDOWS[request.param]


def draw(case: Window, rng: np.random.Generator):
    nx, m = len(case.F), case.N + 1
    e = 3 * rng.standard_normal((len(case.H), m)) + 5 * rng.standard_normal((len(case.H), 1))
    c = 0.005 * rng.standard_normal((nx, m)) * (np.diag(case.G) > 0)[:, None]
    c[:, 0] = 0
    return 0.2 * rng.standard_normal(nx) * (np.diag(case.L) > 0), c, e


def test_states_are_those_of_a_dense_program(case):
    rng = np.random.default_rng(1)
    solver, active = solve(case.chain), 0
    for _ in range(8):
        delta, c, e = draw(case, rng)
        side = rng.integers(-1, 2, (len(case.A), case.N + 1))
        results = run(solver, case, delta, c, e, side)
        x, nu, found, conflict = (results[k] for k in ("x", "nu", "side", "conflict"))
        assert not conflict.any()
        assert results["open"] == 0
        assert results["residual"] < 1e-9
        np.testing.assert_allclose(x, dense(case, delta, c, e), rtol=0, atol=1e-8)
        assert np.all(nu * found >= 0)
        assert np.all(nu[found == 0] == 0)
        active += np.count_nonzero(found)
    assert active > 5


def run(solver, case, delta, c, e, side) -> dict[str, np.ndarray]:
    P = case.chain.stored(case.L @ case.L.T)
    names = ["x", "eta", "nu", "side", "end", "conflict", "residual", "passes", "open"]
    values = solver(delta, P, *case.stages(c, e), side)
    return {k: np.asarray(v) for k, v in zip(names, values, strict=True)}


def dense(case: Window, delta, c, e) -> np.ndarray:
    """Trajectory by a general solver; soft limits get a variable for their violation."""
    H, g, C, low, high, T, t = case.program(delta, c, e)
    soft = np.tile(case.softness > 0, case.N + 1)
    weight = 1 / np.tile(np.where(case.softness > 0, case.softness, 1), case.N + 1)[soft]
    n, s = len(H), int(soft.sum())
    whole = np.zeros((n + s, n + s))
    whole[:n, :n], whole[n:, n:] = H, np.diag(weight)
    give = np.eye(len(C))[:, soft]
    rows = np.vstack([np.hstack([C, give]), np.hstack([C, -give])])
    inf = np.full(len(C), np.inf)
    a, h = ca.DM(rows), ca.DM(whole)
    options = {"error_on_fail": True, "daqp": {"primal_tol": 1e-12, "dual_tol": 1e-12}}
    program = ca.conic("program", "daqp", {"h": h.sparsity(), "a": a.sparsity()}, options)
    found = program(
        h=h, g=np.append(g, np.zeros(s)), a=a,
        lba=np.append(low, -inf), uba=np.append(inf, high),
    )  # fmt: skip
    z = np.asarray(found["x"])[:n, 0]
    return (T @ z + t).reshape(case.N + 1, -1).T


def test_covariance_at_every_sample_has_the_active_limits_in_it():
    """Against the covariance of the dense program projected on the active limits."""
    case = WINDOWS["parameter that hardly walks"]
    delta, c, e = draw(case, np.random.default_rng(2))
    results = run(solve(case.chain), case, delta, c, e, np.zeros((1, case.N + 1)))
    assert results["side"].any()
    H, _, C, _, _, T, _ = case.program(delta, c, e)
    held = C[results["side"].T.ravel() != 0]
    free = np.linalg.svd(held)[2][len(held) :].T
    covariance = T @ free @ np.linalg.inv(free.T @ H @ free) @ free.T @ T.T
    P = case.chain.stored(case.L @ case.L.T)
    for back in (0, 1, 7, case.N):
        side = results["side"]
        given = [delta, P, *case.stages(c, e), side, 0 * side]
        found = np.asarray(case.chain.triangle()(smoothed(case.chain, back)(*given)))[:, 0]
        full = np.zeros((3, 3))
        full.T[np.triu_indices(3)] = found
        k = 3 * (case.N - back)
        expected = covariance[k : k + 3, k : k + 3]
        np.testing.assert_allclose(np.tril(full), np.tril(expected), rtol=1e-6, atol=1e-14)


def test_contradicting_limits_are_named():
    """Speed at least 1 everywhere and displacement within 0.05: not over 16 samples."""
    case = WINDOWS["limits that leave no freedom"]
    stages = case.stages(np.zeros((2, 16)), np.zeros((1, 16)))
    stages[-2][1], stages[-1][1] = 1.0, 2.0
    P = case.chain.stored(np.diag([0.09, 1.0]))
    x, _, _, side, _, conflict, _, _, unfinished = map(
        np.asarray, solve(case.chain)(np.zeros(2), P, *stages, np.zeros((2, 16)))
    )
    assert unfinished == 0
    assert conflict.any(axis=1).all()
    assert not side.any()
    np.testing.assert_allclose(x, 0.0, atol=1e-14)


def test_native_code_does_the_same():
    case = WINDOWS["limits that leave no freedom"]
    m = case.N + 1
    e = ca.MX.sym("e", m)
    c = np.zeros((2, m))
    stages = case.stages(c, np.zeros((1, m)))
    stages[4] = e.T
    x, *_, passes, _ = solve(case.chain)(
        ca.MX.zeros(2),
        ca.MX(case.chain.stored(np.diag([0.09, 1.0]))),
        *map(ca.MX, stages),
        ca.MX.zeros(2, m),
    )
    carry = ca.MX.sym("carry", 1)
    step = ca.Function("window", [carry, e], [carry, ca.vec(x), passes])
    channels = (Channel("x", ("state",)), Channel("passes"))
    recursion = Recursion(step=step, carry0=np.zeros(1), channels=channels, dt=1.0)
    rng = np.random.default_rng(3)
    data = 3 * rng.standard_normal((8, m)) + 5 * rng.standard_normal((8, 1))
    _, (found, passes) = native.run(recursion, [data], carry=recursion.carry0)
    expected = np.array([np.asarray(step(0, row)[1])[:, 0] for row in data])
    np.testing.assert_allclose(found, expected, atol=1e-11)
    assert passes.max() > 8
