"""Single windows of the moving horizon observer, as other solvers get them."""

import dataclasses
import functools

import casadi as ca
import numpy as np

from backsight.algebra.symmetric import unvech
from backsight.engine import native
from backsight.engine.recursion import Channel, Recursion
from backsight.estimators.kalman.ekf import correct
from backsight.estimators.mho import window_cost
from backsight.solvers.box import GaussNewton
from backsight.types import Array
from benchmarks import problems

PLACES = (200, 500, 900, 1400, 1999, 2003, 2007, 2012, 2025, 2050, 2600, 3500)
"""Present sample of every window; the payload is taken off at sample 2000."""


@dataclasses.dataclass(frozen=True)
class Window:
    """Minimise the cost of eq. 26 over the state at the start of a window.

    Parameters
    ----------
    x_bar : (nx,) array
        A-priori estimate, scaled.
    P : (nx, nx) array
        Its covariance.
    U, Y : (N + 1,) arrays
        Inputs and outputs, scaled.
    x : (nx,) array
        The minimiser, by iterations to convergence.
    """

    x_bar: Array
    P: Array
    U: Array
    Y: Array
    x: Array

    @property
    def L(self) -> Array:
        """Lower factor of P."""
        return np.linalg.cholesky(self.P)


@functools.cache
def windows() -> tuple[Window, ...]:
    """Windows of the recording of the stage, with what the pre-filter knew at their start."""
    problem = problems.observer(GaussNewton())
    s, N = problem.setting, problem.estimator.N
    nx = s.model.nx
    recursion, update = problem.recursion, correct(s)
    start = recursion.channels.index(next(c for c in recursion.channels if c.name == "x_start"))
    u, y = problem.data[0] / s.su, problem.data[1] / s.sy
    made = []
    for place in PLACES:
        before = [d[:place] for d in problem.data]
        carry, _ = native.run(recursion, before, carry=recursion.carry0)
        here = [d[place : place + 1] for d in problem.data]
        _, outputs = native.run(recursion, here, carry=carry)
        first = place - N
        # The carry begins with prior and covariance at the start of the coming window.
        x, P, _ = update(carry[:nx], carry[nx : nx + nx * (nx + 1) // 2], u[first], y[first], 1)
        made.append(
            Window(
                x_bar=np.asarray(x).ravel(),
                P=np.asarray(ca.evalf(unvech(ca.SX(P)))),
                U=u[first : place + 1, 0],
                Y=y[first : place + 1, 0],
                x=outputs[start][0] / s.sx,
            )
        )
    return tuple(made)


def minimisers() -> Array:
    """The expected results, (windows, nx)."""
    return np.array([w.x for w in windows()])


def optimiser(method: GaussNewton) -> Recursion:
    """Our optimiser alone, as a recursion without memory over windows."""
    problem = problems.observer(method)
    s, N = problem.setting, problem.estimator.N
    nx = s.model.nx
    cost = window_cost(s, problem.estimator.integrator, N=N, alpha=problem.estimator.alpha)
    minimise = method.minimiser(
        cost, lower=s.lower, upper=s.upper, cost_unit=float(np.mean(np.diag(s.R)))
    )
    carry, x_bar, L = ca.MX.sym("carry"), ca.MX.sym("x_bar", nx), ca.MX.sym("L", nx * nx)
    U, Y, M = (ca.MX.sym(name, N + 1) for name in "UYM")
    x, *_ = minimise(1, x_bar, ca.reshape(L, nx, nx), U.T, Y.T, M.T)
    return Recursion(
        step=ca.Function("optimiser", [carry, x_bar, L, U, Y, M], [carry, x]),
        carry0=np.zeros(1),
        channels=(Channel("x", ("state",)),),
        dt=s.dt,
    )


def rows() -> list[Array]:
    """Windows as the data of `optimiser`, one row each."""
    all_windows = windows()
    U, Y = (np.array([getattr(w, name) for w in all_windows]) for name in "UY")
    L = np.array([w.L.T.ravel() for w in all_windows])
    return [np.array([w.x_bar for w in all_windows]), L, U, Y, np.ones_like(Y)]


def response(s: problems.Setting, integrator: problems.Integrator, x: ca.SX, U: ca.SX) -> ca.SX:
    """Outputs of the model from state x over a window, (N + 1,), for other solvers."""
    h = s.dt / integrator.substeps
    outputs = []
    for k in range(U.numel()):
        outputs.append(s.model.output(x, U[k]))
        for _ in range(integrator.substeps):
            x = integrator.substep(s.model.rhs, x, ua=U[k], ub=U[k], h=h)
    return ca.vertcat(*outputs)
