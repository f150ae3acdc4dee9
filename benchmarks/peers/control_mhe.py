"""python-control's `OptimalEstimationProblem` on one window, in a process of its own.

It needs seconds at best and may not end, so it gets a time limit and no rounds.
"""

import multiprocessing
from multiprocessing.connection import Connection

import casadi as ca
import numpy as np

from backsight.types import Array
from benchmarks import problems
from benchmarks.contest import Row, clock, reason
from benchmarks.windows import Window, windows

PATIENCE = 60.0
"""Seconds after which the attempt is given up."""


def attempt(contest: str, name: str) -> Row:
    """Solve one window, or say what came in the way."""
    window = windows()[0]
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(there, window), daemon=True)
    process.start()
    there.close()
    try:
        answer = here.recv() if here.poll(PATIENCE) else f"did not end within {PATIENCE:.0f} s"
    except EOFError:
        answer = "its process ended without an answer"
    process.kill()
    process.join()
    if isinstance(answer, str):
        return Row(contest, name, failure=answer)
    seconds, x = answer
    time_each = 1e6 * seconds
    difference = float(np.abs(x - window.x).max())
    return Row(contest, name, time_each, time_each, time_each, difference, rounds=1)


def _child(answer: Connection, window: Window) -> None:
    try:
        answer.send(_solve(window))
    except Exception as error:
        answer.send(reason(error))


def _solve(window: Window) -> tuple[float, Array] | str:
    import control

    problem = problems.observer()
    s, N, nx = problem.setting, problem.estimator.N, problem.setting.model.nx
    x, u = ca.SX.sym("x", nx), ca.SX.sym("u")
    ahead, integrator = x, problem.estimator.integrator
    for _ in range(integrator.substeps):
        ahead = integrator.substep(s.model.rhs, ahead, ua=u, ub=u, h=s.dt / integrator.substeps)
    step = ca.Function("step", [x, u], [ahead])
    output = ca.Function("output", [x], [s.model.output(x, ca.SX(0))])
    # The library needs a disturbance; this one moves nothing.
    plant = control.nlsys(
        lambda _t, x, u, _p: np.asarray(step(x, u[0])).ravel(),
        lambda _t, x, _u, _p: np.asarray(output(x)).ravel(),
        inputs=["u", "nothing"],
        outputs=["y"],
        states=nx,
        dt=s.dt,
    )
    weight, R = np.linalg.inv(window.P), s.R[0, 0]
    estimation = control.optimal.OptimalEstimationProblem(
        plant,
        np.arange(N + 1) * s.dt,
        lambda _x, _u, v, w: (w @ w / R + v @ v) / 2,
        terminal_cost=lambda x, x_bar: (x - x_bar) @ weight @ (x - x_bar) / 2,
        control_indices=[0],
        minimize_method="SLSQP",
        minimize_options={"maxiter": 500, "ftol": 1e-9},
    )
    guess = [window.x_bar]
    for k in range(N):
        guess.append(np.asarray(step(guess[-1], window.U[k])).ravel())
    found = []
    seconds, _ = clock(
        lambda: found.append(
            estimation.compute_estimate(
                window.Y[None],
                window.U[None],
                window.x_bar,
                initial_guess=(np.array(guess).T, np.zeros((1, N + 1))),
                print_summary=False,
            )
        )
    )
    if not found[0].success:
        return f"no solution: {found[0].message}"
    return seconds, np.array(found[0].states[:, 0])
