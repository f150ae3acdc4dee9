"""What a fleet costs beside its estimation: ``python -m benchmarks.fleets --recordings 1000``.

By hand: read the recordings and give them to `estimate_many` (or `estimate_summaries`), 64 at a
time, in one process for each worker that a fleet has. Beside the seconds on the clock, which others
on the same machine lengthen, those of the processors are measured.
"""

import argparse
import multiprocessing
import os
import resource
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backsight.engine.parallel import cores

DT, DISTINCT, AT_ONCE = 0.01, 8, 64

PROBLEM = """\
recording = { path = "none.npy", time = "t", inputs.u = "force", outputs.y = "place" }
model = { kind = "sdof", b = 1.0 }
estimate.k = { start = 90.0, sigma = 20.0 }
noise.sigma_y.y = 1e-3
prior.sigma_x0 = { q = 0.1, v = 1.0 }
estimators.EKF.kind = "ekf"
"""


def written(folder: Path, recordings: int, samples: int) -> None:
    """Recordings of springs, some of them again and again under other names."""
    import backsight as bs

    (folder / "runs").mkdir(parents=True)
    (folder / "spring.toml").write_text(PROBLEM, encoding="utf-8")
    (folder / "fleet.toml").write_text(
        'problem = "spring.toml"\nrecordings.files = "runs/*.npy"\n', encoding="utf-8"
    )
    rng = np.random.default_rng(0)
    for number in range(min(DISTINCT, recordings)):
        push = np.repeat(rng.choice([-5.0, 5.0], samples // 20), 20)[:, None]
        truth = bs.sdof(k=80.0 + number, b=1.0)
        told = bs.simulate(truth, push, dt=DT, sigma_y=1e-3, seed=number)
        table = np.zeros(len(told.time), [("t", float), ("force", float), ("place", float)])
        table["t"], table["force"], table["place"] = told.time, told.u[:, 0], told.y[:, 0]
        for copy in range(number, recordings, DISTINCT):
            np.save(folder / "runs" / f"r{copy:06}.npy", table)


def by_hand(folder: Path, paths: Sequence[Path], *, summaries: bool) -> None:
    """What a program of a few lines does in their place."""
    import dataclasses

    import backsight as bs
    from backsight.problem import load
    from backsight.problem.recorded import recording_of

    problem = load(folder / "spring.toml")
    estimator = problem.estimators["EKF"]
    for first in range(0, len(paths), AT_ONCE):
        found = []
        for path in paths[first : first + AT_ONCE]:
            table = problem.recording.model_copy(update={"path": str(path)})
            found.append(recording_of(dataclasses.replace(problem, recording=table)))
        if summaries:
            bs.large.estimate_summaries(estimator, problem.model, found, threads=1)
        else:
            bs.estimate_many(estimator, problem.model, found, threads=1)


def _shares(folder: Path, workers: int, *, summaries: bool) -> None:
    """By hand, in so many processes."""
    paths = sorted((folder / "runs").iterdir())
    crew = [
        multiprocessing.get_context("spawn").Process(
            target=by_hand, args=(folder, paths[k::workers]), kwargs={"summaries": summaries}
        )
        for k in range(workers)
    ]
    for one in crew:
        one.start()
    for one in crew:
        one.join()


def _fleet(folder: Path, workers: int) -> None:
    """A fleet."""
    import backsight as bs

    shutil.rmtree(folder / "store", ignore_errors=True)
    fleet = bs.fleet.load_fleet(folder / "fleet.toml")
    bs.fleet.run_fleet(fleet, folder / "store", workers=workers)


def _spent() -> np.ndarray:
    """Seconds on the clock, and of processors by this process and those that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return np.array([time.perf_counter(), sum(u.ru_utime + u.ru_stime for u in used)])


def main() -> None:
    """Measure in turns, and print seconds and what a recording costs."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleets", description=main.__doc__)
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--only", help="the way that is measured, such as fleet")
    given = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "fleet"
        written(folder, given.recordings, given.samples)
        ways = {
            "estimate_many by hand": lambda: _shares(folder, given.workers, summaries=False),
            "estimate_summaries by hand": lambda: _shares(folder, given.workers, summaries=True),
            "fleet": lambda: _fleet(folder, given.workers),
        }
        ways = {way: act for way, act in ways.items() if given.only in (None, way)}
        best = {way: np.full(2, np.inf) for way in ways}
        for _ in range(given.rounds):
            for way, act in ways.items():
                began = _spent()
                act()
                best[way] = np.minimum(best[way], _spent() - began)
                print("{:30} {:8.1f} s, processors {:8.1f} s".format(way, *best[way]), flush=True)
    each = {way: 1e3 * found[1] / given.recordings for way, found in best.items()}
    for way, milliseconds in each.items():
        print(f"{way:30} {milliseconds:8.2f} ms of a processor for a recording")
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    print(f"memory: {largest:.0f} MB here, at most {children:.0f} MB in a worker")


if __name__ == "__main__":
    main()
