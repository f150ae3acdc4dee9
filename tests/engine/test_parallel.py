"""The one place for work on all cores."""

import math
import threading

import numpy as np
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


@pytest.mark.slow
def test_sensors_are_rated_alike_in_processes():
    sensors = {name: ("displacement", [1.0, c]) for name, c in (("a", 0.9), ("b", 0.1))}
    rod = bs.modal([9.0, 23.0], damping=[0.03, 0.02], sensors=sensors, forces={"hit": [1.0, 0.5]})
    noise, prior = bs.Noise(sigma_y=1e-5, sigma_w=1e-7), bs.Prior(sigma_x0=1e-5)
    finder = bs.CompressiveSensingMHE(noise, prior, forces=("hit",), lam=15.0, N=8)
    hits = bs.tune.Hits(samples=30, number=1, spacing=10)
    here, there = (
        bs.tune.place_sensors(finder, rod, hits, dt=0.01, count=1, runs=4, workers=workers)
        for workers in (1, 2)
    )
    assert here.identical(there)
    assert np.isfinite(here.f1).all()
