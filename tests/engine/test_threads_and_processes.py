"""Threads at once, forks after use, new processes, and an end in the middle of the work."""

import concurrent.futures
import os
import pickle
import subprocess
import sys
import textwrap
import threading

import numpy as np
import pytest

import backsight as bs
from backsight.discrete.runge_kutta import Integrator
from backsight.engine import parallel
from backsight.testing import CASES

QUICK = {"ekf", "csmhe"}
KEYS = [key if key in QUICK else pytest.param(key, marks=pytest.mark.slow) for key in CASES]

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")


def task_of(key):
    """Estimator, model and recording of a case."""
    case = CASES[key]
    problem = case.problem
    estimator = case.build(problem, Integrator("rk4", 1))
    return (
        estimator,
        problem.model,
        problem.simulate(60, seed=3, hold="zoh", noisy=True).recording(problem.model),
    )


def estimated(job):
    """Estimates of a case as bytes: they must agree to the last bit."""
    estimator, model, recording = job
    return np.ascontiguousarray(bs.estimate(estimator, model, recording)["x_hat"].values).tobytes()


@pytest.mark.parametrize("key", KEYS)
def test_eight_threads_at_once_from_the_first_use_on(key, tmp_path, monkeypatch):
    """All compile the same programs for the same empty cache at the same moment."""
    monkeypatch.setenv("BACKSIGHT_CACHE", str(tmp_path))
    together = threading.Barrier(8)

    def work(_):
        together.wait()
        return estimated(task_of(key))

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = set(pool.map(work, range(8)))
    assert found == {estimated(task_of(key))}


@needs_fork
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.filterwarnings("ignore:This process.*is multi-threaded:DeprecationWarning")
def test_a_fork_after_use_goes_on(key):
    job = task_of(key)
    before = estimated(job)
    there, here = os.pipe()
    child = os.fork()
    if not child:
        # Both what the parent has compiled, and what is new.
        same = estimated(job) == before == estimated(task_of(key))
        os.write(here, b"1" if same else b"0")
        os._exit(0)
    os.close(here)
    with os.fdopen(there, "rb") as pipe:
        assert pipe.read() == b"1"
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert estimated(job) == before


@pytest.mark.parametrize("key", KEYS)
def test_what_is_pickled_works_alike(key):
    job = task_of(key)
    again = pickle.loads(pickle.dumps(job))
    assert estimated(again) == estimated(job)
    assert type(again[0]) is type(job[0])


@pytest.mark.slow
def test_new_processes_work_alike():
    jobs = [task_of(key) for key in CASES]
    assert parallel.in_processes(estimated, jobs, workers=2) == [estimated(job) for job in jobs]


def run(script, **how):
    """Run a program that has an estimator at work on a long recording."""
    head = """
        import os, signal, sys, threading, time
        import numpy as np
        import backsight as bs
        model = bs.sdof(k=40.0, b=0.8)
        n = 300_000
        long = bs.from_arrays(
            u=np.zeros((n, 1)), y=np.zeros((n, 1)), dt=0.01,
            inputs={"u": "N"}, outputs={"y": "m"},
        )
        ukf = bs.UKF(bs.Noise(sigma_y=1e-3, sigma_w=1e-3), bs.Prior(sigma_x0=1.0))
        def work():
            while True:
                bs.estimate(ukf, model, long)
    """
    text = textwrap.dedent(head) + textwrap.dedent(script)
    return subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", text],
        capture_output=True, text=True, timeout=120, **how
    )  # fmt: skip


def test_the_interpreter_ends_while_a_thread_is_at_work():
    done = run(
        """
        threading.Thread(target=work, daemon=True).start()
        time.sleep(0.5)
        """
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_an_exit_while_a_thread_is_at_work():
    done = run(
        """
        threading.Thread(target=work, daemon=True).start()
        time.sleep(0.5)
        sys.exit(7)
        """
    )
    assert (done.returncode, done.stderr) == (7, "")


@pytest.mark.slow
def test_ctrl_c_ends_it_within_a_moment():
    done = run(
        """
        def interrupt():
            time.sleep(1.0)
            os.kill(os.getpid(), signal.SIGINT)
        threading.Thread(target=interrupt, daemon=True).start()
        try:
            work()
        except KeyboardInterrupt:
            print("interrupted", threading.active_count())
        """
    )
    assert done.stdout.startswith("interrupted")
    assert (done.returncode, done.stderr) == (0, "")
