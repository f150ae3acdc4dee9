"""OSQP on the windows of the least-squares estimator with limits, each begun with the last one.

The program gets its best coordinates: in the unknown z, the deviation from the solution without
limits in units of its uncertainty, the Hessian is the identity, and from one window to the next
only the limits change. Without limits the windows are solved by products with constant matrices.
"""

import dataclasses

import numpy as np
import scipy

from backsight.estimators.linear_windows import gains, stacked
from backsight.estimators.parts.limits import limits_of
from backsight.estimators.parts.linear import Linear, linear
from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.problems import Problem

WINDOWS = 300
"""Full windows that are solved."""


def build(problem: Problem) -> Contender:
    """Minimise z'z / 2 with limits on G z, where G G' is the covariance of the limited states."""
    import osqp

    estimator, N = problem.estimator, problem.estimator.N
    dt = float(problem.recording.attrs["dt"])
    system = linear(problem.model, dt, noise=estimator.noise, prior=estimator.prior, hold="zoh")
    limits = limits_of(system.s, system.s.Q, (), {})
    free, limited = gains(system, N), _limited(system, limits.state, N)
    on_limits = np.linalg.cholesky(limited.M)
    on_end = np.linalg.solve(on_limits, limited.Psi).T
    lower, upper = (np.tile(bound, N + 1) for bound in (limits.lower, limits.upper))
    s = problem.setting
    U, Y = problem.data[0] / s.su, problem.data[1] / s.sy

    solver = osqp.OSQP()
    size = on_limits.shape[1]
    solver.setup(
        P=scipy.sparse.eye(size, format="csc"),
        q=np.zeros(size),
        A=scipy.sparse.csc_matrix(on_limits),
        l=lower,
        u=upper,
        **SETTINGS,
    )

    def work() -> Array:
        solver.warm_start(x=np.zeros(size), y=np.zeros(len(lower)))
        found = np.empty((WINDOWS, len(system.A)))
        for k in range(WINDOWS):
            window = slice(k, k + N + 1)
            y, u = Y[window].ravel(), U[window].ravel()
            c = limited.K @ y + limited.K_u @ u
            solver.update(l=lower - c, u=upper - c)
            z = solver.solve(raise_error=True).x
            found[k] = free.M @ y + free.N_u @ u + on_end @ z
        return found

    return Contender(work, WINDOWS, expected(problem)[N:])


@dataclasses.dataclass(frozen=True)
class Limited:
    """Limited states of a full window: c = K Y + K_u U, covariance M, with the end Psi."""

    K: Array
    K_u: Array
    M: Array
    Psi: Array


def _limited(system: Linear, rows: Array, N: int) -> Limited:
    """Solve the window for sums of its states, as `gains` does for its last one."""
    nx = len(system.A)
    s = stacked(system, N)
    noise = np.linalg.cholesky(np.kron(np.eye(N + 1), system.s.R))
    white = scipy.linalg.solve_triangular(noise, s.Phi, lower=True)
    q, r = np.linalg.qr(np.vstack([white, np.eye(s.Phi.shape[1])[nx:]]))
    on_state = np.kron(np.eye(N + 1), rows)
    ends = scipy.linalg.solve_triangular(r, np.vstack([on_state @ s.T, s.T[-nx:]]).T, trans=1).T
    limited, present = ends[:-nx], ends[-nx:]
    K = scipy.linalg.solve_triangular(noise, (limited @ q[: len(white)].T).T, lower=True, trans=1).T
    return Limited(
        K=K,
        K_u=on_state @ s.F - K @ s.Gamma,
        M=limited @ limited.T,
        Psi=limited @ present.T,
    )


SETTINGS = {
    "eps_abs": 1e-8,
    "eps_rel": 0.0,
    "max_iter": 100_000,
    "check_termination": 5,
    "verbose": False,
}
"""What it takes to agree to 1e-8."""
