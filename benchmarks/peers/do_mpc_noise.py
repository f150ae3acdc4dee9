"""do-mpc's moving horizon estimator with process noise on all states."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import process_noise
from benchmarks.contest import Contender
from benchmarks.peers.casadi_nlp import QUIET
from benchmarks.peers.shooting_nlp import minimisers, transition
from benchmarks.process_noise import Window

COUNT = 6
"""Windows that are solved."""

FIRST = ("y_first", "counts")
"""The measurement of the first sample, which do-mpc's windows do not have, and whether it counts.

It does where the same windows are solved, and does not when do-mpc runs by itself.
"""


def on_windows(bounds: str) -> Contender:
    """The same windows with the same prior; without the handling of data around them."""
    mhe, windows = _estimator(bounds), process_noise.windows(bounds)[:COUNT]

    def solve(window: Window) -> Array:
        given, unknown = mhe.opt_p_num, mhe.opt_x_num
        first = np.array([window.Y[0], 1.0])
        given["_x_prev"], given["_p_set"] = window.x_bar, first
        for k in range(len(window.Y) - 1):
            given["_y_meas", k] = np.array([window.Y[k + 1], window.U[k]])
        for k, state in enumerate(window.guess):
            unknown["_x", k] = [state] * len(unknown["_x", k])
        mhe.solve()
        return np.asarray(mhe.opt_x_num["_x", len(window.Y) - 1, -1]).ravel()

    return Contender(
        lambda: np.array([solve(w) for w in windows]), len(windows), minimisers(bounds)
    )


def whole(bounds: str, samples: int) -> Callable[[], Array]:
    """Sample after sample by `make_step`, with do-mpc's own arrival state."""
    problem, mhe = process_noise.problem(bounds), _estimator(bounds)
    s = problem.setting
    inputs, outputs = (d[:samples] for d in (problem.data[0] / s.su, problem.data[1] / s.sy))
    mhe.x0 = s.x0
    mhe.set_initial_guess()

    def work() -> Array:
        # Its windows begin with a state, not with a measurement: the first one is not used.
        pairs = zip(outputs[1:], inputs[:-1], strict=True)
        found = [mhe.make_step(np.vstack(pair)).ravel() for pair in pairs]
        return s.sx * np.vstack([s.x0, found])

    return work


def _estimator(bounds: str) -> Any:
    import do_mpc

    problem = process_noise.problem(bounds)
    s, nx = problem.setting, problem.setting.model.nx
    ahead, output = transition(bounds)
    model = do_mpc.model.Model("discrete", "SX")
    x, u = model.set_variable("_x", "x", (nx, 1)), model.set_variable("_u", "u")
    for name in FIRST:
        model.set_variable("_p", name)
    model.set_meas("y", output(x), meas_noise=True)
    model.set_meas("u", u, meas_noise=False)
    model.set_rhs("x", ahead(x, u), process_noise=True)
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
    dx = (mhe._x["x"] - mhe._x_prev["x"]) / np.sqrt(np.diag(s.P0))
    w = mhe._w["x_noise"] / np.sqrt(np.diag(s.sampled().Q))
    y_first, counts = (mhe._p_set[name] for name in FIRST)
    e = counts * (y_first - output(mhe._x["x"]))
    mhe.set_objective(
        ca.sumsqr(mhe._v.cat) / (2 * R) + ca.sumsqr(w) / 2, (ca.sumsqr(dx) + e**2 / R) / 2
    )
    mhe.bounds["lower", "_x", "x"] = s.lower
    template = mhe.get_p_template()
    mhe.set_p_fun(lambda _: template)
    mhe.setup()
    return mhe
