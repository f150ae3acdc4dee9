"""OSQP on the windows of the least-squares estimator with limits, each begun with the last one.

The program gets its best coordinates: in the unknown z, the deviation from the solution without
limits in units of its uncertainty, the Hessian is the identity, and from one window to the next
only the limits change. Without limits the windows are solved by products with constant matrices.
"""

import numpy as np
import scipy

from backsight.estimators.linear_windows import gains, limit_gains
from backsight.estimators.parts.limits import rows_of
from backsight.estimators.parts.linear import linear
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
    rows = rows_of(system, problem.model, ())
    free, limited = gains(system, N), limit_gains(system, rows, N)
    on_limits = np.linalg.cholesky(limited.M)
    on_end = np.linalg.solve(on_limits, limited.Psi).T
    lower, upper = (np.tile(bound, N + 1) for bound in (rows.lower, rows.upper))
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


SETTINGS = {
    "eps_abs": 1e-8,
    "eps_rel": 0.0,
    "max_iter": 100_000,
    "check_termination": 5,
    "verbose": False,
}
"""What it takes to agree to 1e-8."""
