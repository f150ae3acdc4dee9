"""Who competes with whom."""

import importlib
from functools import partial

from backsight.engine.parallel import cores
from backsight.solvers.box import GaussNewton
from benchmarks import (
    beam_contests,
    call_contests,
    every,
    fit_contests,
    noise_contests,
    ours,
    problems,
    sizes,
)
from benchmarks.contest import Contender, Contest, Entry, peer
from benchmarks.problems import Problem

NATIVE = "Backsight, native"
VIRTUAL = "Backsight, virtual machine"
LANES = "Backsight, native, 8 recordings in lanes, 1 core"
CONVERGED = "Backsight, native, iterated to convergence"
GENERATED = "CasADi's C, gcc -O3, buffer interface"
DO_MPC = "do-mpc, same windows"
WHOLE_SAMPLE = "Backsight, whole sample with both filters"
EKF_ODE = "EKF, 6 states, 8 Heun sub-steps, covariance equation"
UKF = "UKF, 5 states, 4 Heun sub-steps"
AHG_FIXED = "Adaptive high-gain observer, fixed gain"
AHG_ADAPTIVE = "Adaptive high-gain observer, adaptive gain"
FREE = "Least-squares estimator, 4 states, window of 21 samples, no limits"
GAPS = "Backsight, native, a fifth of the samples missing"
OSQP = "OSQP from Python, warm start"
FILTERPY = "filterpy"
NUMPY = "NumPy with BLAS"
PYTHON_CONTROL = "python-control, multiple shooting, SLSQP"

OBSERVER = "Moving horizon observer, whole recording"
WINDOW = "One window of the moving horizon observer"
EXTENDED = "Extended Kalman filter, Q once per sample, no bounds"
UNSCENTED = "Unscented Kalman filter"
FILTERS = "Filters and observers of Backsight"
LIMITED = "Least-squares estimator with limits, 5 states, window of 21 samples"
CHAIN = "Extended Kalman filter, 60 states, row of masses"
DENSE = "Extended Kalman filter, 60 states, dense"


def contests() -> tuple[Contest, ...]:
    """All tables, in the order of the page."""
    observer = problems.observer()
    return (
        _observer(observer),
        _window(observer),
        _extended(problems.free_stage_filter()),
        _unscented(problems.punch_filter()),
        _filters(),
        every.contest(),
        _limited(),
        *noise_contests.contests(),
        *beam_contests.contests(),
        _large(CHAIN, problems.chain(30)),
        _large(DENSE, problems.dense(60)),
        *call_contests.contests(),
        *fit_contests.contests(),
        *sizes.contests(),
    )


def _observer(observer: Problem) -> Contest:
    converged = problems.observer(GaussNewton())
    fast = "gcc -O3 -march=native, reassociation"
    strict = partial(_generated, observer, fast=False)
    loose = partial(_generated, observer, fast=True)
    return Contest(
        OBSERVER,
        "us per sample",
        (
            Entry(NATIVE, partial(ours.machine_code, observer)),
            Entry("Backsight, estimate() with all around it", partial(ours.whole_call, observer)),
            Entry(CONVERGED, partial(ours.machine_code, converged)),
            Entry(LANES, partial(_lanes, observer, 8, 1)),
            Entry("the same, all cores", partial(_lanes, observer, 8 * cores(), cores())),
            Entry(VIRTUAL, partial(ours.virtual_machine, observer)),
            Entry(GENERATED, partial(strict, "by_buffer")),
            Entry(f"CasADi's C, {fast}, buffer interface", partial(loose, "by_buffer")),
            Entry("CasADi's C, gcc -O3, loop in C", partial(strict, "in_c")),
            Entry(f"CasADi's C, {fast}, loop in C", partial(loose, "in_c")),
        ),
        "6 states, window of 15 samples, 8 Heun sub-steps, 2 Gauss-Newton iterations, pre- and "
        "post-filter; difference of the lanes from a run by itself, of all others from the other "
        "engine. Estimates of the programs go to memory that is there.",
    )


def _window(observer: Problem) -> Contest:
    return Contest(
        WINDOW,
        "us per window",
        (
            Entry(
                WHOLE_SAMPLE,
                lambda: ours.without_expectation(ours.machine_code(observer)),
            ),
            Entry("Backsight, 2 iterations", partial(ours.on_windows, problems.TWICE)),
            Entry("Backsight, to convergence", partial(ours.on_windows, GaussNewton())),
            Entry("CasADi sqpmethod, qrqp", peer("casadi_nlp", "build", "sqpmethod")),
            Entry("CasADi IPOPT", peer("casadi_nlp", "build", "ipopt")),
            Entry(DO_MPC, peer("do_mpc_mhe", "on_windows")),
            Entry("do-mpc, make_step", peer("do_mpc_mhe", "streaming")),
            Entry("SciPy SLSQP, central differences", peer("scipy_slsqp", "build")),
        ),
        "The same cost, bounds and prior for all; difference from the converged minimiser.",
    )


def _extended(problem: Problem) -> Contest:
    return Contest(
        EXTENDED,
        "us per sample",
        (
            Entry(NATIVE, partial(ours.machine_code, problem)),
            Entry("dynamax (JAX), whole recording", peer("dynamax_ekf", "build", problem)),
            Entry(VIRTUAL, partial(ours.virtual_machine, problem)),
            Entry(FILTERPY, peer("filterpy_kf", "extended", problem, 300)),
        ),
        "6 states, 8 Heun sub-steps.",
    )


def _unscented(problem: Problem) -> Contest:
    return Contest(
        UNSCENTED,
        "us per sample",
        (
            Entry(NATIVE, partial(ours.machine_code, problem)),
            Entry(VIRTUAL, partial(ours.virtual_machine, problem)),
            Entry(FILTERPY, peer("filterpy_kf", "unscented", problem, 300)),
        ),
        "5 states, 4 Heun sub-steps, punch.",
    )


def _filters() -> Contest:
    problem = {
        EKF_ODE: problems.stage_filter("ode"),
        "EKF, the same, transition of every sub-step": problems.stage_filter("transition"),
        UKF: problems.punch_filter(),
        AHG_FIXED: problems.punch_observer(adaptive=False),
        AHG_ADAPTIVE: problems.punch_observer(adaptive=True),
        FREE: problems.masses(unknown_force=False),
    }
    entries = (Entry(name, partial(ours.machine_code, p)) for name, p in problem.items())
    return Contest(FILTERS, "us per sample", tuple(entries), "Native engine, whole recording.")


def _limited() -> Contest:
    problem = problems.masses(unknown_force=True)
    gaps = problems.masses(unknown_force=True, missing=0.2)
    return Contest(
        LIMITED,
        "us per sample",
        (
            Entry(NATIVE, partial(ours.machine_code, problem)),
            Entry(GAPS, partial(ours.machine_code, gaps)),
            Entry(VIRTUAL, partial(ours.virtual_machine, problem)),
            Entry(OSQP, peer("osqp_qp", "build", problem)),
        ),
        "Two masses with an unknown force that switches between its bounds: more than half of the "
        "samples in a window are at one. OSQP gets the window already condensed to its 21 limited "
        "quantities, with the identity as Hessian, so that only the limits change.",
    )


def _large(title: str, problem: Problem) -> Contest:
    return Contest(
        title,
        "us per sample",
        (
            Entry(NATIVE, partial(ours.machine_code, problem)),
            Entry(NUMPY, peer("numpy_ekf", "build", problem)),
        ),
    )


def _lanes(problem: Problem, recordings: int, threads: int) -> Contender:
    return ours.in_lanes(problem, ours.stage_recordings(problem, recordings), threads)


def _generated(problem: Problem, way: str, *, fast: bool) -> Contender:
    module = importlib.import_module("benchmarks.peers.casadi_c")
    return getattr(module, way)(problem, module.FAST if fast else [])
