"""The one place for work on all cores."""

import math
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest

import backsight as bs
from backsight.engine import parallel


def test_results_come_in_the_order_of_the_jobs():
    jobs = [7, 3, 5, 1]
    expected = [math.factorial(job) for job in jobs]
    assert parallel.in_threads(math.factorial, jobs, threads=3) == expected
    counts: list[int] = []
    for workers in (1, 2):
        found = parallel.in_processes(math.factorial, jobs, workers=workers, progress=counts.append)
        assert found == expected
    assert counts == [1, 2, 3, 4] * 2
    assert parallel.in_threads(math.factorial, []) == []
    assert parallel.in_processes(math.factorial, []) == []


def test_an_error_stops_those_that_still_work():
    stopped = threading.Event()

    def task(job):
        if job == 0:
            raise KeyError("the first")
        assert stopped.wait(30)

    with pytest.raises(KeyError, match="the first"):
        parallel.in_threads(task, [0, 1], threads=2, stop=stopped.set)
    with pytest.raises(ValueError, match="factorial"):
        parallel.in_processes(math.factorial, [-1, 2], workers=2)


KILLED = """
import os, sys, time
from backsight.engine.parallel import in_processes

if __name__ == "__main__":
    in_processes(time.sleep, [60.0, 60.0], workers=2)
"""


@pytest.mark.slow
def test_processes_end_with_the_one_that_was_killed(tmp_path):
    """With SIGKILL nobody can tell them; they are alone in their group otherwise."""
    script = tmp_path / "script.py"
    script.write_text(KILLED)
    with subprocess.Popen([sys.executable, str(script)]) as process:
        try:
            parent = psutil.Process(process.pid)
            end = time.monotonic() + 60
            while len(workers := _spawned(parent)) < 2:
                assert time.monotonic() < end
                time.sleep(0.01)
        finally:
            process.kill()
    _, alive = psutil.wait_procs(workers, timeout=20)
    for worker in alive:
        worker.kill()
    assert not alive


def _spawned(parent: psutil.Process) -> list[psutil.Process]:
    """Those that have begun to work: a second thread watches by then."""
    found = [p for p in parent.children() if "spawn_main" in " ".join(p.cmdline())]
    return [p for p in found if p.num_threads() > 1]


@pytest.mark.slow
def test_sensors_are_rated_alike_in_processes():
    rod = bs.modal(
        [9.0, 23.0],
        damping=[0.03, 0.02],
        sensors={name: ("displacement", [1.0, c]) for name, c in (("a", 0.9), ("b", 0.1))},
        forces={"hit": [1.0, 0.5]},
    )
    noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    hits = bs.tune.Hits(samples=30, number=1, spacing=10)
    here, there = (
        bs.tune.place_sensors(finder, rod, hits, dt=0.01, count=1, runs=4, workers=workers)
        for workers in (1, 2)
    )
    assert here.identical(there)
    assert np.isfinite(here.f1).all()
