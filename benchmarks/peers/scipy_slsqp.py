"""SciPy's SLSQP with central differences: how the observer's authors solved it, in MATLAB.

The response of the model is computed by CasADi's virtual machine, which is many times faster than
Python would be.
"""

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import problems
from benchmarks.contest import Contender
from benchmarks.peers.casadi_nlp import each
from benchmarks.windows import Window, response


def build() -> Contender:
    from scipy.optimize import minimize

    problem = problems.observer()
    s, N, nx = problem.setting, problem.estimator.N, problem.setting.model.nx
    x, U, Y = ca.SX.sym("x", nx), ca.SX.sym("U", N + 1), ca.SX.sym("Y", N + 1)
    e = Y - response(s, problem.estimator.integrator, x, U)
    loss = ca.Function("loss", [x, U, Y], [ca.sumsqr(e) / s.R[0, 0]])
    buffer, evaluate = loss.buffer()
    state, value = np.zeros(nx), np.zeros(1)
    buffer.set_arg(0, memoryview(state))
    buffer.set_res(0, memoryview(value))
    bounds = list(zip(s.lower, s.upper, strict=True))

    def solve(window: Window) -> Array:
        weight = np.linalg.inv(window.P)
        buffer.set_arg(1, memoryview(window.U))
        buffer.set_arg(2, memoryview(window.Y))

        def cost(x: Array) -> float:
            state[:] = x
            evaluate()
            dx = x - window.x_bar
            return float(dx @ weight @ dx + value[0]) / 2

        options = {"ftol": 1e-12, "maxiter": 200}
        found = minimize(
            cost, window.x_bar, method="SLSQP", jac="3-point", bounds=bounds, options=options
        )
        return found.x

    return each(solve, count=6)
