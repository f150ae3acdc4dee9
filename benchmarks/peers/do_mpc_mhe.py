"""do-mpc's moving horizon estimator, given the cost of the observer."""

from typing import Any

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import problems
from benchmarks.contest import Contender
from benchmarks.peers.casadi_nlp import QUIET, each
from benchmarks.windows import Window, windows


def on_windows() -> Contender:
    """The same windows with the same prior; without the handling of data around them."""
    mhe = _estimator()

    def solve(window: Window) -> Array:
        given = mhe.opt_p_num
        given["_x_prev"] = window.x_bar
        given["_p_set"] = _weights(window)
        for k in range(len(window.Y) - 1):
            given["_y_meas", k] = np.array([window.Y[k + 1], window.U[k]])
        mhe.opt_x_num["_x"] = window.x_bar
        mhe.solve()
        return np.asarray(mhe.opt_x_num["_x", 0, -1]).ravel()

    return each(solve, count=6)


def streaming() -> Contender:
    """Sample after sample by `make_step`, warm started, with do-mpc's own arrival state."""
    mhe, window = _estimator(), windows()[0]
    mhe.x0 = window.x_bar
    mhe.set_initial_guess()
    samples = [np.array([[y], [u]]) for y, u in zip(window.Y, window.U, strict=True)]
    for sample in samples:
        mhe.make_step(sample)

    def work() -> Array:
        return np.array([mhe.make_step(sample) for sample in samples])

    return Contender(work, len(samples))


def _weights(window: Window) -> Array:
    return np.concatenate([np.linalg.inv(window.P).ravel(), window.Y[:1]])


def _estimator() -> Any:
    import do_mpc

    problem = problems.observer()
    s, nx = problem.setting, problem.setting.model.nx
    model = do_mpc.model.Model("discrete", "SX")
    x, u = model.set_variable("_x", "x", (nx, 1)), model.set_variable("_u", "u")
    model.set_variable("_p", "W", (nx * nx, 1))
    model.set_variable("_p", "y_start")
    model.set_meas("y", s.model.output(x, u), meas_noise=True)
    model.set_meas("u", u, meas_noise=False)
    integrator = problem.estimator.integrator
    ahead = x
    for _ in range(integrator.substeps):
        ahead = integrator.substep(s.model.rhs, ahead, ua=u, ub=u, h=s.dt / integrator.substeps)
    model.set_rhs("x", ahead)
    model.setup()

    mhe = do_mpc.estimator.MHE(model, [])
    mhe.set_param(
        n_horizon=problem.estimator.N,
        t_step=s.dt,
        meas_from_data=True,
        store_full_solution=False,
        nlpsol_opts=QUIET["ipopt"] | {"print_time": False},
    )
    R = s.R[0, 0]
    v = mhe._v.cat
    dx = mhe._x["x"] - mhe._x_prev["x"]
    e = mhe._p_set["y_start"] - s.model.output(mhe._x["x"], ca.SX(0))
    W = ca.reshape(mhe._p_set["W"], nx, nx)
    mhe.set_objective(ca.sumsqr(v) / (2 * R), (dx.T @ W @ dx + e**2 / R) / 2)
    mhe.bounds["lower", "_x", "x"] = s.lower
    template = mhe.get_p_template()
    *W0, y0 = _weights(windows()[0])
    template["W"], template["y_start"] = W0, y0
    mhe.set_p_fun(lambda _: template)
    mhe.setup()
    return mhe
