"""A Kalman filter in NumPy whose matrix products are BLAS's, for models with many states."""

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks.contest import Contender
from benchmarks.ours import expected
from benchmarks.problems import Problem


def build(problem: Problem) -> Contender:
    """Transition of a linear model computed once, then three lines of algebra per sample."""
    s = problem.setting
    nx, nu = s.model.nx, s.model.nu
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u", nu)
    if s.model.continuous:
        integrator = problem.estimator.integrator
        ahead = integrator.substep(s.model.rhs, x, ua=u, ub=u, h=s.dt)
        half = s.dt / 2 * s.Qc
    else:
        ahead, half = s.model.rhs(x, u), 0 * s.Q
    matrices = ca.Function(
        "matrices",
        [x, u],
        [ca.jacobian(ahead, x), ca.jacobian(ahead, u), ca.jacobian(s.model.output(x, u), x)],
    )
    F, G, H = (np.asarray(ca.densify(m)) for m in matrices(0, 0))
    Q = half + F @ half @ F.T + s.Q
    inputs, outputs = problem.data[0] / s.su, problem.data[1] / s.sy
    eye = np.eye(nx)

    def work() -> Array:
        x, P = s.x0.copy(), s.P0.copy()
        x_hat = np.empty((len(inputs), nx))
        for k in range(len(inputs)):
            PHt = P @ H.T
            K = np.linalg.solve(H @ PHt + s.R, PHt.T).T
            x = x + K @ (outputs[k] - H @ x)
            left = eye - K @ H
            P = left @ P @ left.T + K @ s.R @ K.T
            x_hat[k] = x
            x = F @ x + G @ inputs[k]
            P = F @ P @ F.T + Q
        return x_hat

    return Contender(work, len(inputs), expected(problem))
